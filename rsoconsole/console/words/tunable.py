"""The settings that can be tuned while a night goes on: labels, steps, bounds, and their words."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rsoconsole.config import LEARNINGS, PRESETS

Value = float | int | str


@dataclass(frozen=True, slots=True, kw_only=True)
class Tunable:
    """A setting that can be tuned: its steps, bounds or choices."""

    name: str
    label: str
    unit: str = ""
    factor: float = 1.25
    """Factor on the value for one step."""
    low: float = 0.0
    high: float = math.inf
    choices: tuple[str, ...] = ()
    preset: str | None = None
    """Filter preset that alone uses the setting; None: every preset does."""

    def step_value(self, value: Value, by: int) -> Value:
        """Return the value or choice ``by`` steps on, within the bounds, to three digits."""
        if self.choices:
            at = self.choices.index(str(value)) if value in self.choices else 0
            return self.choices[(at + by) % len(self.choices)]
        stepped = float(value) * self.factor**by
        return float(f"{min(max(stepped, self.low), self.high):.3g}")

    def words(self, value: Value | None) -> str:
        """Return a value with its unit, in words; None: "-"."""
        if value is None:
            return "-"
        return f"{value:.4g}{self.unit}" if isinstance(value, float | int) else value

    def short_words(self, value: Value) -> str:
        """Return label and value in few cells: Q×100; a choice alone."""
        if isinstance(value, str):
            return value
        return (
            f"{self.label.replace(' ×', '×')}{'' if self.label.endswith('×') else ' '}{value:.3g}"
        )

    def change_words(self, before: Value | None, after: Value) -> str:
        """Return a change of the value in words: Q× 1 → 2.25."""
        return f"{self.label.replace(' ×', '×')} {self.words(before)} → {self.words(after)}"


def _multiplier(of: str, label: str) -> Tunable:
    factor = 1.5 if of.startswith("q") else 1.25
    return Tunable(name=f"filter.{of}_multiplier", label=label, factor=factor, low=1e-6, high=1e6)


TUNABLES = (
    Tunable(name="detector.tau", label="τ", low=0.01, high=0.99),
    _multiplier("q", "Q ×"),
    _multiplier("r", "R ×"),
    Tunable(name="filter.preset", label="preset", choices=PRESETS),
    Tunable(name="filter.learning", label="learning", choices=LEARNINGS),
    Tunable(name="filter.sigma_arcsec", label="σ", unit="″", low=0.05, high=600.0, preset="paper"),
    Tunable(
        name="filter.q_arcsec2_s3",
        label="q",
        unit=" ″²/s³",
        factor=2.0,
        low=1e-9,
        high=1e3,
        preset="tuned",
    ),
    _multiplier("q_ra", "Q α ×"),
    _multiplier("q_ra_rate", "Q α rate ×"),
    _multiplier("q_dec", "Q δ ×"),
    _multiplier("q_dec_rate", "Q δ rate ×"),
    _multiplier("r_ra", "R α ×"),
    _multiplier("r_dec", "R δ ×"),
    Tunable(name="filter.gate_nis", label="gate NIS", low=1.0, high=1e6),
    Tunable(name="filter.max_coast_s", label="lost after", unit=" s", low=10.0, high=86400.0),
    Tunable(name="filter.max_3sigma_arcmin", label="lost at 3σ", unit="′", low=0.1, high=600.0),
)
BY_NAME = {tunable.name: tunable for tunable in TUNABLES}
NAMES = tuple(BY_NAME)
PRESET, LEARNING = "filter.preset", "filter.learning"


def change_words(before: Mapping[str, Value], after: Mapping[str, Value], begin: str = "") -> str:
    """Return the settings that two mappings give differently, in few cells: Q×100 R×0.1.

    ``begin``: of the names of the settings that count. One that ``after`` lacks is left out.
    """
    changed = (
        (each, after[each.name])
        for each in TUNABLES
        if each.name.startswith(begin)
        and each.name in after
        and after[each.name] != before.get(each.name)
    )
    return " ".join(each.short_words(value) for each, value in changed)
