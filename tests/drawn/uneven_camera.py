"""A camera with faults drawn by hand, its frames, and the masters that one would make of it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsoconsole.records import FloatArray, Frame
from tests.drawn.drawn_lines import line_of_light

SHAPE = HEIGHT, WIDTH = 720, 960
OFFSET_ADU, READ_ADU, SKY_E, RIDGE_E = 500.0, 5.0, 6000.0, 108.0
"""A streak whose ridge is 1.4 of the sky's own noise, and a sixth of what the pixels' response
differs by."""
STREAK = 300.0, 300.0, 400.0, 345.0
FRAMES_A_MASTER = 16


@dataclass(frozen=True)
class UnevenCamera:
    """Hot pixels, pieces of hot columns, glow; vignetting, dust, pixels of 5 % different response.

    One electron is one ADU.
    """

    dark_e: FloatArray
    """In the exposure."""
    response: FloatArray
    rng: np.random.Generator

    @classmethod
    def made(cls, seed: int) -> "UnevenCamera":
        rng = np.random.default_rng(seed)
        y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
        dark = 40.0 + 400.0 * np.exp(-np.hypot(x - WIDTH, y) / 150.0)
        for _ in range(20):
            column, top = rng.integers(30, WIDTH - 30), rng.integers(30, HEIGHT - 200)
            dark[top : top + rng.integers(50, 160), column] += rng.uniform(1000.0, 2500.0)
        hot = rng.integers(0, dark.size, 3000)
        dark.ravel()[hot] += rng.exponential(3000.0, hot.size)
        off_axis = np.hypot(x - WIDTH / 2, y - HEIGHT / 2) / np.hypot(WIDTH / 2, HEIGHT / 2)
        response = (1.0 - 0.5 * off_axis**2) * (1.0 + rng.normal(0.0, 0.05, SHAPE))
        for _ in range(6):
            away = np.hypot(x - rng.uniform(50, WIDTH - 50), y - rng.uniform(50, HEIGHT - 50))
            response *= 1.0 - 0.15 * np.exp(-(((away - 14.0) / 4.0) ** 2))
        return cls(dark, response, rng)

    def note_frame(self, light_e: FloatArray | float, scale: float = 1.0) -> FloatArray:
        """Whole ADU, float64; ``scale``: of the exposure that the dark current belongs to."""
        light = self.rng.poisson(light_e * self.response).astype(float)
        light += self.rng.poisson(scale * self.dark_e) + self.rng.normal(
            OFFSET_ADU, READ_ADU, SHAPE
        )
        return np.clip(np.rint(light), 0.0, 65535.0)

    def frame(self, **other: Any) -> Frame:
        """Stars and one faint streak of 10 s."""
        light = SKY_E + RIDGE_E * line_of_light(SHAPE, STREAK, 1.2) / 0.3325
        y, x = np.mgrid[-6:7, -6:7]
        point = np.exp(-(y**2 + x**2) / (2.0 * 1.2**2))
        for _ in range(80):
            row, column = self.rng.integers(10, HEIGHT - 10), self.rng.integers(10, WIDTH - 10)
            around = np.s_[row - 6 : row + 7, column - 6 : column + 7]
            light[around] += self.rng.exponential(3000.0) * point
        values = {"frame_id": 1, "name": "a", "exposure_s": 10.0, "scale_arcsec_px": 1.26} | other
        return Frame(pixels=self.note_frame(light).astype(np.uint16), **values)

    def master(self, light_e: float = 0.0, scale: float = 1.0) -> FloatArray:
        """The mean of some frames: as many as they are, their electrons are one draw."""
        many = FRAMES_A_MASTER * (light_e * self.response + scale * self.dark_e)
        mean = self.rng.poisson(many) / FRAMES_A_MASTER
        return mean + self.rng.normal(OFFSET_ADU, READ_ADU / FRAMES_A_MASTER**0.5, SHAPE)

    def masters(self) -> tuple[FloatArray, FloatArray]:
        """(dark with the offset, flat without)."""
        dark = self.master()
        return dark, self.master(20000.0) - dark
