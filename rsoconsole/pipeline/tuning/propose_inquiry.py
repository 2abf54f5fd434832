"""Evidence of one set of tracks on Q and R, by comparison of models. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from rsoconsole.pipeline.tuning._propose_likelihood import Innovations, ReplayedTrack, innovations
from rsoconsole.pipeline.tuning._propose_search import HALF_WIDTH, Fit, LikelihoodSearch, Parameter
from rsoconsole.tracking import mean_nis_band

Verdict: TypeAlias = Literal["not enough to say", "no change is called for", "change"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposedParameter:
    """Parameter of the filter with its proposed value and the evidence for it."""

    label: str
    names: tuple[str, ...]
    recorded: float
    proposed: float
    """Value to set; the recorded one where no change of this parameter is called for."""
    likeliest: float
    interval_68: tuple[float, float]
    """Interval in which log L falls by 0.5 at most; by 2 for preset tuned (see ``WIDENED``)."""
    is_on_bound: bool
    is_flat: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedTerm:
    """Term of Q or R, with the gain in log L by fitting it separately."""

    label: str
    gain: float
    """Gain in log L by a value of its own."""
    needed: float
    is_taken: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConsistency:
    """Consistency of a filter, judged by its innovations."""

    log_likelihood: float
    nis_mean: float
    nis_band: tuple[float, float]
    autocorrelation_east: float
    autocorrelation_north: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldOut:
    """Test on the second half of the innovations of Q and R fitted to the first half."""

    innovations: int
    gain: float
    """Gain in log L of the second half over the recorded settings; below 0 the fit is worse."""
    nis_mean_before: float
    nis_mean_after: float
    nis_band: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Proposal of Q and R by maximum likelihood, with the evidence for it."""

    sessions: tuple[Path, ...]
    preset: str
    verdict: Verdict
    words: str
    changes: Mapping[str, float] = field(default_factory=dict)
    """Proposed settings, by dotted name; empty where none is proposed."""
    innovations: int
    tracks: int
    gain: float | None = None
    """Gain in log L of the likeliest Q and R over the recorded ones; None without a search."""
    needed: float | None = None
    parameters: tuple[ProposedParameter, ...] = ()
    terms: tuple[FittedTerm, ...] = ()
    before: FilterConsistency | None = None
    after: FilterConsistency | None = None
    """Consistency with the proposed settings; equal to ``before`` where no change is called for."""
    autocorrelation_bound: float | None = None
    """Bound on the absolute autocorrelation of white innovations, exceeded 5 times in 100."""
    hold_out: HoldOut | None = None
    rounds: int = 0
    evaluations: int = 0
    warnings: tuple[str, ...] = ()


LEAST = 15
"""Fewest innovations from which a statement on Q and R is made."""
CHANCE, CHANCE_OF_A_TERM = 0.05, 0.01
"""Probabilities to reach the needed gain by chance: for Q and R, and for one more term."""
WIDENED = {"paper": 1.0, "tuned": 2.0, "adaptive": 2.0}
"""Factor on the widths of intervals, by preset; needed gains grow with its square.

The tuned filter uses each innovation twice, in S and in its process noise. Over simulated nights of
60 frames and known noise the likeliest R scattered by 0.18 in its logarithm, where the profile of
log L gave 0.09, and the sandwich of its scores no more. The adaptive one uses them twice as well.
"""
LEARNING = {"paper": "auto", "tuned": "on", "adaptive": "off"}
"""Whether each preset learns the noise while settings are compared: for none it changes at 1."""
WORTH_A_FIT = 0.3
"""Fraction of the needed gain that a term must reach alone before it is fitted with the others."""
_ABOUT = (0.01, 0.1, 0.5, 2.0, 10.0, 100.0)
"""Values at which a parameter is looked for first, in units of the recorded one."""
FLAT_DECADES = 4.0
"""Width of a 68 % interval, in powers of ten, from which the likelihood counts as flat."""


class ModelComparison:
    """Compares models of Q and R on one set of tracks."""

    def __init__(
        self, arcs: Sequence[ReplayedTrack], preset: str, on_evaluation: Callable[[], None]
    ) -> None:
        self._arcs = arcs
        self._preset = preset
        self.count = sum(len(arc.measurements) for arc in arcs)
        self._widened = WIDENED[preset]
        self.search = LikelihoodSearch(lambda settings: _total(self._run(settings)), on_evaluation)
        self._half = self.count // 2
        self.warnings: list[str] = []
        self._limited: set[str] = set()
        """Labels of the parameters to which the data set a limit only."""
        if self.count:
            self._q, self._r, self._others = self._parameters()

    def run(self) -> dict[str, float]:
        """Search for the best model; return the settings to change, by dotted name; {} for none."""
        search = self.search
        self._recorded = search.fit(())
        both = search.fit((self._q, self._r))
        self._both = both
        self._needed = self._gain_needed(CHANCE, 2)
        self._terms: list[FittedTerm] = []
        self._chosen = self._likeliest = self._recorded
        if both.log_likelihood - self._recorded.log_likelihood >= self._needed:
            self._chosen = self._fewest(both)
            for other in self._others:
                self._try_term(other)
            self._likeliest = self._chosen
            self._heed_limits()
            self._chosen = self._rounded(self._chosen)
        return self._chosen.settings()

    def _fewest(self, both: Fit) -> Fit:
        """Return the fit of R or Q alone where the other adds no more than chance would.

        Once a change is called for, the plain threshold holds: Q and R depend on each other, and
        one held at its recorded value pulls the other along.
        """
        for alone in (self._r, self._q):
            fit = self.search.fit((alone,), start=both)
            if both.log_likelihood - fit.log_likelihood < _needed(CHANCE, 1):
                return fit
        return both

    def _gain_needed(self, chance: float, parameters: int) -> float:
        return _needed(chance, parameters) * self._widened**2

    def _heed_limits(self) -> None:
        """Propose the limit of each parameter to which the data set a limit only.

        A calm half hour is likeliest with no process noise at all; a night in which the satellite
        turns is lost with it.
        """
        for parameter in self._likeliest.parameters:
            is_open = self.search.unbounded_sides(parameter, self._likeliest)
            if is_open[0] == is_open[1]:
                continue
            # Of a parameter that is sought alone the limit is the wider one, beside the other.
            is_alone = len(self._likeliest.parameters) == 1
            beside = self._both if is_alone else self._likeliest
            interval = self.search.interval(parameter, beside)
            limit, word = (interval[1], "at most") if is_open[0] else (interval[0], "at least")
            self._limited.add(parameter.label)
            others = (p for p in self._chosen.parameters if p.names != parameter.names)
            held = (parameter.fixed_at(limit), *others)
            self._chosen = self.search.fit(held, start=self._chosen)
            self.warnings.append(
                f"{parameter.label}: the data give a limit alone, {word} {limit:.2g}; it is what is"
                " proposed"
            )

    def _rounded(self, fit: Fit) -> Fit:
        """Return the fit rounded to three digits: no night determines more."""
        rounded = replace(fit, values=tuple(float(f"{value:.3g}") for value in fit.values))
        return replace(rounded, log_likelihood=_total(self._run(rounded.settings())))

    def _try_term(self, other: Parameter) -> None:
        needed = self._gain_needed(CHANCE_OF_A_TERM, 1)
        gain = self.search.gain_lower_bound(other, self._chosen)
        fit = self._chosen
        if gain >= WORTH_A_FIT * needed:
            fit = self.search.fit((*self._chosen.parameters, other), start=self._chosen)
            gain = fit.log_likelihood - self._chosen.log_likelihood
        term = FittedTerm(label=other.label, gain=gain, needed=needed, is_taken=gain >= needed)
        self._terms.append(term)
        if term.is_taken:
            self._chosen = fit

    def proposal(self, folders: tuple[Path, ...], rounds: int, evaluations: int) -> Proposal:
        """Return the proposal with the evidence for it, after ``run``.

        ``rounds``, ``evaluations``: numbers of rounds of the search and of runs of the filter, to
        be reported.
        """
        is_change = bool(self._chosen.parameters)
        parameters = self._evidence()
        self._warn(parameters)
        before, after = self._run({}), self._run(self._chosen.settings())
        assert before is not None
        assert after is not None
        hold_out = self._held_out()
        if is_change and hold_out is not None and hold_out.gain < 0.0:
            self.warnings.append(
                "what fits the first half of the innovations does not fit the second: wait for more"
            )
        gain = self._both.log_likelihood - self._recorded.log_likelihood
        gain = max(gain, self._chosen.log_likelihood - self._recorded.log_likelihood)
        words = f"log L gains {gain:.1f} of {self.count} innovations, {self._needed:.1f} needed"
        verdict: Verdict = "change" if is_change else "no change is called for"
        return Proposal(
            sessions=folders,
            preset=self._preset,
            verdict=verdict,
            words=f"{verdict}: {words}",
            changes=self._chosen.settings(),
            innovations=self.count,
            tracks=len(self._arcs),
            gain=gain,
            needed=self._needed,
            parameters=parameters,
            terms=tuple(self._terms),
            before=_soundness(before),
            after=_soundness(after),
            autocorrelation_bound=1.96 / float(np.sqrt(self.count)),
            hold_out=hold_out,
            rounds=rounds,
            evaluations=evaluations,
            warnings=tuple(self.warnings),
        )

    def _run(self, settings: Mapping[str, float]) -> Innovations | None:
        changes: dict[str, float | str] = {"learning": LEARNING[self._preset]}
        changes |= {name.removeprefix("filter."): value for name, value in settings.items()}
        return innovations(self._arcs, changes)

    def _evidence(self) -> tuple[ProposedParameter, ...]:
        """Return Q, R and the accepted terms, each with its profile about the likeliest values."""
        taken = [p for p in self._likeliest.parameters if p not in (self._q, self._r)]
        best = self._both
        if taken:
            best = self.search.fit((self._q, self._r, *taken), start=self._likeliest)
        return tuple(self._proposed(parameter, best) for parameter in best.parameters)

    def _proposed(self, parameter: Parameter, best: Fit) -> ProposedParameter:
        fall = HALF_WIDTH * self._widened**2
        low, high = self.search.interval(parameter, best, fall)
        likeliest = best.value(parameter)
        return ProposedParameter(
            label=parameter.label,
            names=parameter.names,
            recorded=parameter.recorded,
            proposed=self._chosen.value(parameter),
            likeliest=likeliest,
            interval_68=(low, high),
            is_on_bound=not parameter.low * 1.01 < likeliest < parameter.high / 1.01,
            is_flat=float(np.log10(high / low)) > FLAT_DECADES,
        )

    def _warn(self, parameters: Sequence[ProposedParameter]) -> None:
        for each in parameters:
            if each.label in self._limited:
                continue
            if each.is_flat:
                self.warnings.append(f"{each.label}: the likelihood is flat, the data do not tell")
            elif each.is_on_bound:
                self.warnings.append(f"{each.label}: the likeliest value lies on the search's edge")
        for parameter in (self._q, self._r):
            values = {getattr(c, _field(parameter)) for c in self._configs()}
            if len(values) > 1:
                found = ", ".join(f"{value:g}" for value in sorted(values))
                self.warnings.append(f"{parameter.names[0]} was not the same throughout: {found}")

    def _held_out(self) -> HoldOut | None:
        """Fit the same parameters to the first half; None where a half is too short."""
        if self._half < LEAST:
            return None
        parameters = self._chosen.parameters or (self._q, self._r)
        half = self._half

        def of_first_half(settings: Mapping[str, float]) -> float:
            found = self._run(settings)
            return -np.inf if found is None else float(np.sum(found.log_likelihood[:half]))

        search = LikelihoodSearch(of_first_half, self.search.on_evaluation)
        start = self._chosen if self._chosen.parameters else self._both
        fit = search.fit(parameters, start=start, is_coarse=True)
        before, after = self._run({}), self._run(fit.settings())
        assert before is not None
        assert after is not None
        gain = float(np.sum(after.log_likelihood[half:] - before.log_likelihood[half:]))
        return HoldOut(
            innovations=self.count - half,
            gain=gain,
            nis_mean_before=float(np.mean(before.nis[half:])),
            nis_mean_after=float(np.mean(after.nis[half:])),
            nis_band=mean_nis_band(self.count - half),
        )

    def _configs(self) -> list[Any]:
        return [step.settings for arc in self._arcs for step in arc.steps]

    def _parameters(self) -> tuple[Parameter, Parameter, tuple[Parameter, ...]]:
        """Return Q, R, and the terms that may have a value of their own."""

        def parameter(
            label: str, low: float, high: float, *names: str, scan: tuple[float, ...] = _ABOUT
        ) -> Parameter:
            dotted = tuple(f"filter.{name}" for name in names)
            recorded = _in_force(self._configs(), names[0])
            return Parameter(
                label=label, names=dotted, recorded=recorded, low=low, high=high, scan=scan
            )

        r = parameter("R", 1e-4, 1e4, "r_multiplier", scan=(0.03, 0.1, 0.3, 0.6, 1.7, 3.0, 10.0))
        r_dec = parameter("R of declination", 1e-4, 1e4, "r_dec_multiplier")
        q_dec = parameter(
            "Q of declination", 1e-6, 1e6, "q_dec_multiplier", "q_dec_rate_multiplier"
        )
        if self._preset == "tuned":
            decades = tuple(10.0**n for n in (-4, -3, -2, -1, 1, 2, 3))
            q = parameter("Q", 1e-10, 1e2, "q_arcsec2_s3", scan=decades)
            return q, r, (r_dec, q_dec)
        if self._preset == "adaptive":
            decades = tuple(10.0**n for n in (-3, -2, -1, 1, 2, 3))
            return parameter("Q", 1e-4, 1e4, "q_multiplier", scan=decades), r, (r_dec, q_dec)
        decades = tuple(10.0**n for n in range(-11, 3, 1))
        q = parameter("Q", 1e-12, 1e6, "q_multiplier", scan=decades)
        rates = parameter(
            "Q of the rates", 1e-6, 1e6, "q_ra_rate_multiplier", "q_dec_rate_multiplier"
        )
        q_dec = parameter("Q of declination's place", 1e-6, 1e6, "q_dec_multiplier")
        return q, r, (rates, q_dec, r_dec)


def _total(found: Innovations | None) -> float:
    return -np.inf if found is None else found.total


def _needed(chance: float, parameters: int) -> float:
    """Gain in log L that parameters without effect reach with this probability (Wilks 1938)."""
    from scipy.special import chdtri

    return float(chdtri(parameters, chance)) / 2.0


def _field(parameter: Parameter) -> str:
    return parameter.names[0].removeprefix("filter.")


def _in_force(configs: Sequence[Any], name: str) -> float:
    """Return the value in force at most steps."""
    values = [float(getattr(config, name)) for config in configs]
    return max(set(values), key=values.count)


def _soundness(found: Innovations) -> FilterConsistency:
    east, north = found.autocorrelation
    return FilterConsistency(
        log_likelihood=found.total,
        nis_mean=float(np.mean(found.nis)),
        nis_band=mean_nis_band(len(found.nis)),
        autocorrelation_east=east,
        autocorrelation_north=north,
    )
