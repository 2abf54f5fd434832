"""Stone Soup's trackers on the nights of ``slots``: GNN, JPDA and MFA with one set of parameters.

They are given what would help them: places in which a slot all but stands still, the true scatter
of the shutter as part of every streak's covariance, and how fast members of a slot move. Needs
``requirements-peers.txt``.
"""

import datetime
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from tests.campaign.slots import BOX_ARCSEC, FALSE, SHUTTER_S, Night, Sight, shared_covariance
from tests.campaign.slots_judge import At

MIN_POINTS, MAX_MISSES = 2, 6
"""Streaks before a track is shown, and frames without one after which it ends."""
_START_RATE_ARCSEC_S = 0.05
"""Sigma of a new track's rate against the slot's."""
Method = Literal["GNN", "JPDA", "MFA"]
_T0 = datetime.datetime(2023, 6, 22)  # noqa: DTZ001 -- Stone Soup's times have no zone


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One set of parameters."""

    method: Method
    q_arcsec2_s3: float
    """White acceleration."""
    gate: float
    """Probability that the gate holds the true one."""
    clutter: float
    """In units of the true density of false streaks."""
    detected: float
    window: int = 0
    """Frames, of MFA."""
    components: int = 0
    """Kept of a track, of MFA."""
    shutter_s: float = SHUTTER_S
    """Scatter of the shutter that it believes in."""

    @property
    def words(self) -> str:
        """For tables and files."""
        said = (
            f"q {self.q_arcsec2_s3:g}, gate {self.gate:g}, clutter {self.clutter:g}, "
            f"detected {self.detected:g}"
        )
        if self.shutter_s != SHUTTER_S:
            said += f", shutter {self.shutter_s:g} s"
        if self.method == "MFA":
            said += f", window {self.window}, components {self.components}"
        return said


def grid(method: Method) -> list[Cell]:
    """Every cell that is tried on the slot of the closest approach.

    Of MFA, which takes three times as long, at one gate, density and chance of detection.
    """
    is_deep = method == "MFA"
    return [
        Cell(
            method=method,
            q_arcsec2_s3=q,
            gate=gate,
            clutter=clutter,
            detected=detected,
            window=window,
            components=components,
        )
        for q in (1e-8, 1e-6, 1e-4)
        for gate in ((0.9999,) if is_deep else (0.99, 0.9999))
        for clutter in ((1.0,) if is_deep else (1.0, 30.0))
        for detected in ((0.9,) if is_deep else (0.9, 0.98))
        for window, components in ([(3, 6), (5, 12)] if is_deep else [(0, 0)])
    ]


def around(cell: Cell, *, is_shutter_known: bool = True) -> list[Cell]:
    """What is tried on every slot: its process noise, which alone matters (README.md).

    Where nobody knows the shutter its scatter as well.
    """
    shutters_s = (SHUTTER_S,) if is_shutter_known else (0.05, 0.1, SHUTTER_S, 0.4)
    return [
        replace(cell, q_arcsec2_s3=q, shutter_s=shutter_s)
        for q in (1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
        for shutter_s in shutters_s
    ]


def followed(night: Night, cell: Cell) -> list[list[At]]:
    """The tracks after each frame."""
    tracker = _Tracker(cell)
    return [tracker.step(sight) for sight in night.frames]


class _Tracker:
    def __init__(self, cell: Cell) -> None:
        from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
        from stonesoup.dataassociator.probability import JPDA
        from stonesoup.deleter.time import UpdateTimeStepsDeleter
        from stonesoup.hypothesiser.probability import PDAHypothesiser
        from stonesoup.initiator.simple import MultiMeasurementInitiator
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import (
            CombinedLinearGaussianTransitionModel,
            ConstantVelocity,
        )
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.types.state import GaussianState
        from stonesoup.updater.kalman import KalmanUpdater

        self.cell = cell
        model = CombinedLinearGaussianTransitionModel([ConstantVelocity(cell.q_arcsec2_s3)] * 2)
        plain = LinearGaussian(4, (0, 2), np.eye(2))
        self.predictor, self.updater = KalmanPredictor(model), KalmanUpdater(plain)
        hypothesiser = PDAHypothesiser(
            self.predictor,
            self.updater,
            clutter_spatial_density=cell.clutter * FALSE / BOX_ARCSEC**2,
            prob_detect=cell.detected,
            prob_gate=cell.gate,
        )
        nearest = GNNWith2DAssignment(hypothesiser)
        if cell.method == "GNN":
            self.associator: Any = nearest
        elif cell.method == "JPDA":
            self.associator = JPDA(hypothesiser)
        else:
            from stonesoup.dataassociator.mfa import MFADataAssociator
            from stonesoup.hypothesiser.mfa import MFAHypothesiser

            self.associator = MFADataAssociator(
                MFAHypothesiser(hypothesiser), slide_window=cell.window
            )
        rate2 = _START_RATE_ARCSEC_S**2
        self.initiator = MultiMeasurementInitiator(
            prior_state=GaussianState([[0.0]] * 4, np.diag([1.0, rate2, 1.0, rate2])),
            measurement_model=plain,
            deleter=UpdateTimeStepsDeleter(2),
            data_associator=nearest,
            updater=self.updater,
            min_points=MIN_POINTS,
        )
        self.tracks: list[Any] = []
        self.missed: dict[str, int] = {}
        self.numbers: dict[str, int] = {}

    def step(self, sight: Sight) -> list[At]:
        """The tracks after a frame."""
        time = _T0 + datetime.timedelta(microseconds=(sight.t_utc_ns - 1_687_392_000 * 10**9) / 1e3)
        found = list(_detections(sight, time, self.cell.shutter_s))
        free, heaviest = set(found), dict[str, Any]()
        if self.tracks:
            told = self._associated(found, time)
            for track, hypotheses in told.items():
                taken = self._taken(track, hypotheses)
                heaviest[track.id] = taken
                free.discard(taken)
        self.missed = {
            t.id: 0 if heaviest.get(t.id) is not None else self.missed.get(t.id, 0) + 1
            for t in self.tracks
        }
        self.tracks = [t for t in self.tracks if self.missed[t.id] < MAX_MISSES]
        for track in sorted(self.initiator.initiate(free, time), key=_east):
            heaviest[track.id] = track.state.hypothesis.measurement
            self.missed[track.id] = 0
            self.tracks.append(self._begun(track))
        return [
            At(
                track_id=self.numbers.setdefault(t.id, len(self.numbers) + 1),
                place=_place_of(t),
                taken=None if (m := heaviest.get(t.id)) is None else m.metadata["id"],
            )
            for t in self.tracks
        ]

    def _associated(self, found: Sequence[Any], time: datetime.datetime) -> Any:
        try:
            return self.associator.associate(set(self.tracks), set(found), time)
        except (ValueError, RuntimeError):
            # Of MFA's mixtures too much was cut off: no choice of histories is left that gives no
            # streak to two tracks. The likeliest of each goes on, without its history.
            for track in self.tracks:
                track.states[-1] = _mixture(_state_of(track))
            return self.associator.associate(set(self.tracks), set(found), time)

    def _begun(self, track: Any) -> Any:
        if self.cell.method != "MFA":
            return track
        track.states.append(_mixture(track.state))
        return track

    def _taken(self, track: Any, hypotheses: Any) -> Any:
        """Update a track; the detection that weighs most, or None."""
        if self.cell.method == "GNN":
            taken = bool(hypotheses)
            track.append(self.updater.update(hypotheses) if taken else hypotheses.prediction)
            return hypotheses.measurement if taken else None
        if self.cell.method == "JPDA":
            return self._averaged(track, hypotheses)
        return self._branched(track, hypotheses)

    def _averaged(self, track: Any, hypotheses: Any) -> Any:
        from stonesoup.functions import gm_reduce_single
        from stonesoup.types.array import StateVectors
        from stonesoup.types.update import GaussianStateUpdate

        states = [self.updater.update(each) if each else each.prediction for each in hypotheses]
        weights = np.asarray([each.probability for each in hypotheses])
        mean, covariance = gm_reduce_single(
            StateVectors([each.state_vector for each in states]),
            np.stack([each.covar for each in states], axis=2),
            weights,
        )
        time = states[0].timestamp
        track.append(GaussianStateUpdate(mean, covariance, hypotheses, time))
        best = max(hypotheses, key=lambda each: each.probability)
        return best.measurement if best else None

    def _branched(self, track: Any, hypotheses: Any) -> Any:
        from stonesoup.types.update import GaussianMixtureUpdate

        kept = sorted(hypotheses, key=lambda each: -float(each.prediction.weight))
        kept = kept[: self.cell.components]
        components = [self.updater.update(each) if each else each.prediction for each in kept]
        track.append(GaussianMixtureUpdate(hypotheses, components))
        return kept[0].measurement if kept[0] else None


def _detections(sight: Sight, time: datetime.datetime, shutter_s: float) -> Iterator[Any]:
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import Detection

    shared = shared_covariance(sight.rate, shutter_s)
    for m, place in zip(sight.measurements, sight.places, strict=True):
        ee, en, nn = m.cov_sky_arcsec2
        noise = np.array([[ee, en], [en, nn]]) + shared
        yield Detection(
            place.reshape(2, 1),
            timestamp=time,
            measurement_model=LinearGaussian(4, (0, 2), noise),
            metadata={"id": m.measurement_id},
        )


def _mixture(state: Any) -> Any:
    """Of one component."""
    from stonesoup.types.mixture import GaussianMixture
    from stonesoup.types.numeric import Probability
    from stonesoup.types.state import TaggedWeightedGaussianState

    component = TaggedWeightedGaussianState(
        state.state_vector,
        state.covar,
        timestamp=state.timestamp,
        weight=Probability(1),
        tag=[],
    )
    return GaussianMixture([component])


def _state_of(track: Any) -> Any:
    components = getattr(track.state, "components", None)
    return max(components, key=lambda each: float(each.weight)) if components else track.state


def _place_of(track: Any) -> tuple[float, float]:
    vector = _state_of(track).state_vector
    return float(vector[0, 0]), float(vector[2, 0])


def _east(track: Any) -> float:
    return _place_of(track)[0]
