"""Figures of merit of filter updates: innovations, NIS and likelihood. Pure."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import NamedTuple, TypeVar

from rsoconsole.night.frame import FrameRow, NightFrame
from rsoconsole.records import TrackState
from rsoconsole.tracking import Consistency, consistency, mean_nis_band


class FilterUpdate(NamedTuple):
    """Innovation of a filter update, with its sigmas and its NIS."""

    residual_arcsec: tuple[float, float]
    """Innovation (RA on the sky, Dec), arcsec."""
    sigma_arcsec: tuple[float, float] | None
    nis: float | None

    @property
    def is_within_3_sigma(self) -> bool:
        """True where the innovation lies within 3 sigma on both axes; False without sigmas."""
        if self.sigma_arcsec is None:
            return False
        pairs = zip(self.residual_arcsec, self.sigma_arcsec, strict=True)
        return all(abs(off) <= 3.0 * sigma for off, sigma in pairs)

    @property
    def log_likelihood(self) -> float | None:
        """Log likelihood of the innovation; None without NIS or sigmas.

        Source: Bar-Shalom et al. 2001, ch. 5.4.
        """
        if self.sigma_arcsec is None or self.nis is None or min(self.sigma_arcsec) <= 0.0:
            return None
        return -math.log(2.0 * math.pi * math.prod(self.sigma_arcsec)) - 0.5 * self.nis


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterQuality:
    """Figures of merit of filter updates; None where no update gives a figure.

    Residuals are innovations (measured minus predicted) of all measurements that the track took.
    """

    updates: int
    residual_rms_arcsec: float | None
    """Root mean square of the residuals, both axes together, arcsec."""
    residual_east_rms_arcsec: float | None
    residual_north_rms_arcsec: float | None
    nis_mean: float | None
    """Mean NIS; 2 for a consistent filter."""
    nis_band: tuple[float, float] | None
    """Bounds within which the mean NIS of a consistent filter lies with probability 95 %."""
    inside_3sigma: float | None
    """Fraction of updates with a residual within 3 sigma on both axes; 0.995 when consistent."""
    log_likelihood_mean: float | None
    """Mean log likelihood of innovations in arcsec; only the NIS counts the axes' correlation."""

    @property
    def is_nis_sound(self) -> bool | None:
        """True where the mean NIS lies within ``nis_band``; None where it is not known."""
        if self.nis_mean is None or self.nis_band is None:
            return None
        return self.nis_band[0] <= self.nis_mean <= self.nis_band[1]


def updates_of(states: Iterable[TrackState | None]) -> list[FilterUpdate]:
    """Return the updates among a track's states: those that have an innovation."""
    return [
        FilterUpdate(each.innovation_arcsec, each.sigma_innovation_arcsec, each.nis)
        for each in states
        if each is not None and each.innovation_arcsec is not None
    ]


def filter_quality(updates: Sequence[FilterUpdate]) -> FilterQuality:
    """Compute the figures of merit of some filter updates."""
    nis = [each.nis for each in updates if each.nis is not None]
    terms = [term for each in updates if (term := each.log_likelihood) is not None]
    east, north = (rms([each.residual_arcsec[axis] for each in updates]) for axis in (0, 1))
    return FilterQuality(
        updates=len(updates),
        residual_rms_arcsec=None if east is None or north is None else math.hypot(east, north),
        residual_east_rms_arcsec=east,
        residual_north_rms_arcsec=north,
        nis_mean=fmean(nis) if nis else None,
        nis_band=mean_nis_band(len(nis)) if nis else None,
        inside_3sigma=fmean(each.is_within_3_sigma for each in updates) if updates else None,
        log_likelihood_mean=fmean(terms) if terms else None,
    )


def rms(values: Sequence[float]) -> float | None:
    """Return the root mean square of values; None without values."""
    return math.sqrt(fmean(value**2 for value in values)) if values else None


_FrameT = TypeVar("_FrameT", FrameRow, NightFrame)


def since_last_change(frames: Sequence[_FrameT]) -> Sequence[_FrameT]:
    """Return the newest frames: those with the filter settings of the newest."""

    def of_filter(frame: _FrameT) -> dict[str, float | int | str]:
        return {n: v for n, v in frame.settings.items() if n.startswith("filter.")}

    first = len(frames)
    for frame in reversed(frames):
        # Settings are one object until one of them is changed.
        is_alike = frame.settings is frames[-1].settings or of_filter(frame) == of_filter(
            frames[-1]
        )
        if not is_alike:
            break
        first -= 1
    return frames[first:]


def consistency_of(frames: Sequence[NightFrame]) -> Consistency:
    """Judge the consistency of the filter by the lead's updates since its settings changed."""
    updated = [frame for frame in frames if frame.updated and frame.updated.nis is not None]
    states = (frame.updated for frame in since_last_change(updated))
    updates = [each for each in updates_of(states) if each.nis is not None]
    nis = [each.nis for each in updates if each.nis is not None]
    return consistency(nis, [each.residual_arcsec for each in updates])
