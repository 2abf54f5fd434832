"""How likely a measured candidate is a satellite: the network's word and the line fit's together.

The network sees a map of maxima, in which a chain of stars or a cosmic ray can look like a faint
streak. The line fit on the raw frame tells them apart: a real streak holds its light along a
line of the seeing's width. A logistic curve over both, fitted on frames with known truth, makes
their product a probability.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rsoconsole.errors import ModelError
from rsoconsole.records import Detection

FEATURES = ("constant", "network", "log_snr", "width_misfit", "shortness")
MOST_LOG_SNR = 0.3
SHORT_FWHM = 20.0
"""Below so many widths of a star, shorter is less likely: chains of stars are short."""
_LEAST, _MOST = 1e-7, 1.0 - 1e-7


@dataclass(frozen=True, slots=True)
class ConfidenceCurve:
    """Weights of the logistic curve, in the order of ``FEATURES``."""

    weights: tuple[float, ...]

    @classmethod
    def from_card(cls, card: Mapping[str, Any]) -> "ConfidenceCurve":
        """As the network's card gives them. Raises ModelError when they are missing."""
        try:
            table = card["measured_confidence"]["weights"]
            return cls(tuple(float(table[name]) for name in FEATURES))
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(
                f"the network's card has no curve of measured confidence ({error}): "
                "reinstall rsoconsole, or run models.confidence for your own network"
            ) from error

    def confidence(self, detection: Detection, psf_fwhm_px: float) -> float:
        """Probability, 0 to 1, of a measured candidate that carries the network's confidence."""
        features = confidence_features(detection, psf_fwhm_px)
        z = sum(w * f for w, f in zip(self.weights, features, strict=True))
        return 1.0 / (1.0 + math.exp(-min(max(z, -30.0), 30.0)))


def confidence_features(detection: Detection, psf_fwhm_px: float) -> tuple[float, ...]:
    """What the curve looks at, in the order of ``FEATURES``.

    The network's log-odds; the logarithm of the fit's matched signal to noise over 20, no more
    than ``MOST_LOG_SNR``, since a chain of bright stars is bright too; how far, as a logarithm,
    the streak's width is from the stars'; how short it is against ``SHORT_FWHM``.
    """
    p = min(max(detection.confidence, _LEAST), _MOST)
    psf_px = max(psf_fwhm_px, 0.1)
    return (
        1.0,
        math.log(p / (1.0 - p)),
        min(math.log(max(detection.snr, 0.1) / 20.0), MOST_LOG_SNR),
        abs(math.log(max(detection.width_px, 0.1) / psf_px)),
        max(0.0, math.log(SHORT_FWHM * psf_px / max(detection.length_px, 0.1))),
    )
