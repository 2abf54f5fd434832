"""Thin moving clouds: their transmission as a function of direction and time.

The deck drifts with the wind over the ground; its mean extinction follows a schedule, and its
structure is a sum of plane waves, so that frames can be drawn in any order and neighbouring frames
agree.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.simulator.camera.rendering import frame_rng

FloatArray = npt.NDArray[np.float64]
_WAVES = 40
_STREAM = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class CloudDeck:
    """A night's clouds: extinction by time, structure and wind."""

    schedule: tuple[tuple[float, float], ...]
    """Nodes (seconds since the scenario's start, mean magnitudes lost), linear in between."""
    structure: float = 0.45
    """One sigma of the natural logarithm of the extinction from place to place."""
    wind_deg_s: tuple[float, float] = (0.045, 0.012)
    """Drift (towards west, towards north) relative to the ground."""

    def extinction_mag(
        self, west_deg: FloatArray, north_deg: FloatArray, t_s: float, seed: int
    ) -> FloatArray:
        """Extinction towards these directions at one instant, in magnitudes.

        ``west_deg``: hour angle times cos dec. ``north_deg``: declination. ``t_s``: seconds since
        the scenario's start.
        """
        if not self.schedule:
            return np.zeros(np.shape(west_deg))
        times, means = zip(*self.schedule, strict=True)
        mean = float(np.interp(t_s, times, means))
        if mean <= 0.0:
            return np.zeros(np.shape(west_deg))
        rng = frame_rng(seed, _STREAM)
        wavelength_deg = np.exp(rng.uniform(np.log(0.25), np.log(5.0), _WAVES))
        heading = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        phase = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        amplitude = np.sqrt(wavelength_deg)
        amplitude *= self.structure * np.sqrt(2.0 / np.sum(amplitude**2))
        x = np.asarray(west_deg)[..., None] - self.wind_deg_s[0] * t_s
        y = np.asarray(north_deg)[..., None] - self.wind_deg_s[1] * t_s
        along = (x * np.cos(heading) + y * np.sin(heading)) / wavelength_deg
        waves = np.sum(amplitude * np.cos(2.0 * np.pi * along + phase), axis=-1)
        return np.asarray(mean * np.exp(waves - 0.5 * self.structure**2))

    def transmission(
        self, west_deg: FloatArray, north_deg: FloatArray, t_s: tuple[float, float], seed: int
    ) -> npt.NDArray[np.float32]:
        """Mean fraction of light transmitted in these directions from ``t_s[0]`` to ``t_s[1]``.

        ``west_deg``: hour angle times cos dec. ``north_deg``: declination. ``t_s``: seconds since
        the scenario's start.
        """
        instants = np.linspace(t_s[0], t_s[1], 5)
        through = [
            10.0 ** (-0.4 * self.extinction_mag(west_deg, north_deg, float(t), seed))
            for t in instants
        ]
        return np.asarray(np.mean(through, axis=0), dtype=np.float32)
