"""Streaks compared with the frame before and the catalogue, by the product's own path."""

from dataclasses import replace

import numpy as np
import pytest

from models.star_catalogue import catalogue_of as catalogue_of_stars
from rsoconsole.config import Config
from rsoconsole.pipeline import FrameReducer, Reduction
from rsoconsole.pipeline.comparison import fixed_light
from rsoconsole.pipeline.comparison.fixed_light import (
    FrameComparison,
    KnownStars,
    RecordedComparison,
)
from rsoconsole.pipeline.comparison.look_back import SolvedField
from rsoconsole.pipeline.frame.reduce import CHART_STARS
from rsoconsole.records import BelowTau, Detections, Frame, NotAStreak, Solution, Wcs
from rsoconsole.session import decode, encode
from rsoconsole.sky import StarCatalogue, Stars, sky_to_pixel
from rsoconsole.tracking import TRACKABLE_CLASSES
from rsoconsole.vision import (
    FEATURES,
    PRIOR,
    ConfidenceCurve,
    FrameMap,
    NetworkBox,
    StarList,
    find_stars,
    most_likely_class,
    update_probabilities,
)
from rsoconsole.words import text
from tests.drawn.drawn_skies import (
    DrawnSky,
    Ends,
    flashes,
    on_line,
    plate,
    points,
    solved,
    streak_at,
)

SURE = ConfidenceCurve(tuple(1.0 if each.endswith("network") else 0.0 for each in FEATURES))
"""Whatever the network is."""
UNLIKE = np.array([1.0, 0.8, 0.9, 1.1, 0.8, 1.0])
SIX = np.linspace(0.0, 1.0, 6)
CLOSE: Ends = (240.0, 250.0, 277.6, 263.7)
"""Six stars on it are 8 px apart: the line fit takes them for one streak."""
FAINT_ADU, BRIGHT_ADU = 8000.0, 40000.0


class Boxed:
    """A network that sees the same line in every frame, or nothing."""

    verifier = None

    def __init__(self, ends: Ends) -> None:
        x, y = sorted(ends[::2]), sorted(ends[1::2])
        self.boxes: tuple[NetworkBox, ...] = (
            NetworkBox(
                confidence=0.9,
                corners_px=(x[0] - 4.0, y[0] - 4.0, x[1] + 4.0, y[1] + 4.0),
                ends_px=(ends[0], ends[1], ends[2], ends[3]),
            ),
        )

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        return self.boxes


class Solved:
    """Knows the plate of each frame by its number."""

    def __init__(self, plates: dict[int, Wcs]) -> None:
        self.plates = plates

    def configure(self, config: Config) -> None:
        pass

    def forget(self) -> None:
        pass

    def solve(self, frame: Frame, stars: StarList) -> Solution:
        return solved(frame, self.plates[frame.frame_id])


PLATES = {1: plate((21.0, -9.0)), 2: plate(), 3: plate((-14.0, 33.0))}


def reducer(ends: Ends = CLOSE, comparison=None) -> FrameReducer:
    return FrameReducer(Boxed(ends), SURE, Solved(PLATES), Config(), comparison=comparison)


def sky_with(seed: int, is_chain: bool) -> DrawnSky:
    sky = DrawnSky.with_field(seed)
    sky.clear_about(CLOSE)
    if is_chain:
        sky.add(*on_line(CLOSE, SIX), FAINT_ADU * UNLIKE)
    return sky


def night(seed: int, *, is_chain: bool, **kwargs) -> tuple[Reduction, Frame]:
    """The second of two frames: six stars in a row in both, or six flashes in the second."""
    sky, made = sky_with(seed, is_chain), reducer(**kwargs)
    lights = [] if is_chain else [points(*on_line(CLOSE, SIX), FAINT_ADU * UNLIKE)]
    made.reduce(sky.frame(1, PLATES[1]))
    frame = sky.frame(2, PLATES[2], *lights)
    return made.reduce(frame), frame


# -- the product's path ------------------------------------------------------------------------


def test_one_frame_alone_takes_stars_in_a_row_for_a_streak():
    """What the second frame is needed for: the same pixels are as good as flashes."""
    sky = sky_with(5, is_chain=True)
    found = reducer().reduce(sky.frame(2, PLATES[2]))
    (streak,) = found.detections.detections
    assert len(found.measurements) == 1
    assert streak.confidence > 0.5


def test_the_brightest_stars_are_kept_for_a_chart_where_they_are():
    sky = sky_with(5, is_chain=False)
    stars = reducer().reduce(sky.frame(2, PLATES[2])).chart_stars
    assert 8 <= len(stars) <= CHART_STARS
    assert list(stars) == sorted(stars, key=lambda star: -star.flux_adu)
    x, y = sky_to_pixel(PLATES[2], sky.ra_deg, sky.dec_deg)
    for star in stars[:8]:
        near = np.argmin(np.hypot(x - star.x_px, y - star.y_px))
        assert (star.x_px, star.y_px) == pytest.approx((x[near], y[near]), abs=1.0)
        assert star.flux_adu > 0.7 * sky.flux_adu[near]


@pytest.mark.parametrize("seed", range(5, 9))
def test_with_the_frame_before_they_are_a_chain_and_no_measurement(seed):
    found, _ = night(seed, is_chain=True)
    assert found.detections.detections == ()
    assert found.measurements == ()
    rejected, *below_tau = found.detections.rejected
    assert all(isinstance(each.reason, BelowTau) for each in below_tau)
    assert rejected.reason == NotAStreak(kind="fixed in the sky")
    assert "stars in a row" in text(rejected.reason)
    streak = rejected.detection
    assert streak.object_class == "star chain"
    assert streak.object_class not in TRACKABLE_CLASSES
    assert streak.class_probability > 0.95
    assert streak.confidence < 0.05
    assert found.absence == "no detection"


@pytest.mark.parametrize("seed", range(5, 9))
def test_with_the_frame_before_flashes_are_a_satellites(seed):
    found, _ = night(seed, is_chain=False)
    (streak,) = found.detections.detections
    assert streak.object_class == "satellite"
    assert len(found.measurements) == 1
    assert found.measurements[0].object_class == "satellite"


def test_a_pulse_is_told_in_time_once_its_streak_is_no_chain_any_more():
    sky = DrawnSky.with_field(11)
    ends: Ends = (200.0, 250.0, 330.0, 285.0)
    sky.clear_about(ends)
    frame = sky.frame(2, PLATES[2], flashes(ends, 12, 3000.0, 0.5))
    chain = streak_at(
        ends,
        frame,
        object_class="star chain",
        class_probability=most_likely_class(PRIOR)[1],
        modulation_period_px=11.0,
    )
    shares = {"satellite": 0.2, "star chain": 0.8}
    chain = replace(chain, class_probability=most_likely_class(shares)[1])
    found = Detections(frame_id=2, width_px=600, height_px=600, detections=(chain,))
    words = {chain: fixed_light.StreakComparison(comparison="new light")}
    (told,) = fixed_light.apply_comparisons(found, words, {chain: shares}, frame).detections
    assert told.object_class == "satellite"
    assert told.modulation_period_s == pytest.approx(10.0 * 11.0 / chain.length_px)


def test_the_same_frames_give_the_same_again():
    one, other = (night(6, is_chain=True)[0] for _ in range(2))
    assert replace(one.detections, stage_ms={}) == replace(other.detections, stage_ms={})


def test_a_look_that_breaks_costs_no_frame(monkeypatch, caplog):
    def broken(*_: object, **__: object) -> None:
        raise ValueError("broken")

    monkeypatch.setattr(fixed_light, "compare_streaks", broken)
    found, _ = night(6, is_chain=True)
    assert len(found.measurements) == 1
    assert "not compared" in caplog.text


def test_what_was_rejected_as_fixed_is_so_again_when_its_frame_is_looked_at_alone():
    found, frame = night(7, is_chain=True)
    alone = reducer(comparison=RecordedComparison(found.detections)).reduce(frame)
    assert replace(alone.detections, stage_ms={}) == replace(found.detections, stage_ms={})
    unknown = reducer(comparison=RecordedComparison(None)).reduce(frame)
    assert len(unknown.detections.detections) == 1


def test_the_reasons_go_on_record():
    found, _ = night(8, is_chain=True)
    kind, _, body = encode(found.detections)
    assert decode(kind, body) == found.detections


def test_what_lies_below_tau_is_compared_too_and_another_tau_does_not_admit_it():
    sky, made = sky_with(9, is_chain=True), reducer()
    made.configure(Config.model_validate({"detector": {"tau": 0.95}}))
    made.reduce(sky.frame(1, PLATES[1]))
    found = made.reduce(sky.frame(2, PLATES[2])).detections
    rejected, *_ = found.rejected
    assert rejected.reason == NotAStreak(kind="fixed in the sky")
    first = reducer()
    first.configure(Config.model_validate({"detector": {"tau": 0.95}}))
    alone, *_ = first.reduce(sky.frame(2, PLATES[2])).detections.rejected
    assert isinstance(alone.reason, BelowTau)


# -- the catalogue -----------------------------------------------------------------------------


def catalogue_of(sky: DrawnSky, faintest_mag: float = 12.5) -> StarCatalogue:
    """All of its stars down to a magnitude; 40,000 ADU are one of 9.5 mag."""
    magnitude = 9.5 - 2.5 * np.log10(sky.flux_adu / BRIGHT_ADU)
    kept = magnitude < faintest_mag
    return catalogue_of_stars(
        Stars.without_proper_motion(sky.ra_deg[kept], sky.dec_deg[kept], magnitude[kept])
    )


def known_of(sky: DrawnSky, *lights: np.ndarray, **kwargs) -> tuple[KnownStars | None, Frame]:
    frame = replace(sky.frame(2, PLATES[2], *lights), t_start_utc_ns=None)
    field = SolvedField(
        frame=frame, stars=find_stars(frame.pixels), solution=solved(frame, PLATES[2])
    )
    return KnownStars.of(field, catalogue_of(sky, **kwargs)), frame


LONG: Ends = (240.0, 250.0, 330.0, 285.0)


def test_catalogue_stars_that_have_all_of_the_light_are_the_streak():
    sky = DrawnSky.with_field(21)
    sky.clear_about(LONG)
    sky.add(*on_line(LONG, SIX), FAINT_ADU * UNLIKE)
    known, frame = known_of(sky)
    assert known is not None
    word = known.compare(streak_at(LONG, frame))
    assert word is not None
    assert word.comparison == "catalogue stars"
    assert word.reason == NotAStreak(kind="catalogue stars", value=6)
    assert text(word.reason) == "6 catalogue stars in a row have its light"


def test_flashes_brighter_than_all_stars_that_the_catalogue_lacks_are_no_stars():
    sky = DrawnSky.with_field(22)
    sky.clear_about(LONG)
    known, frame = known_of(sky, points(*on_line(LONG, SIX), BRIGHT_ADU * UNLIKE))
    assert known is not None
    word = known.compare(streak_at(LONG, frame, 800.0))
    assert word is not None
    assert (word.comparison, word.reason) == ("no catalogue stars", None)


def test_stars_that_the_catalogue_does_not_reach_say_nothing():
    sky = DrawnSky.with_field(23)
    sky.clear_about(LONG)
    sky.add(*on_line(LONG, SIX), FAINT_ADU * UNLIKE)
    known, frame = known_of(sky, faintest_mag=10.9)
    assert known is None or known.compare(streak_at(LONG, frame)) is None


def test_a_streak_that_passes_catalogue_stars_is_none_of_them():
    sky = DrawnSky.with_field(24)
    sky.clear_about(LONG)
    sky.add(*on_line(LONG, np.array([0.3, 0.75])), np.array([9000.0, 7000.0]))
    known, frame = known_of(sky, flashes(LONG, 1, 16000.0, 1.0))
    assert known is not None
    word = known.compare(streak_at(LONG, frame))
    assert word is None or word.reason is None


def test_without_the_catalogues_stars_in_the_frame_nothing_is_said():
    sky = DrawnSky.with_field(25)
    frame = sky.frame(2, PLATES[2])
    field = SolvedField(
        frame=frame, stars=find_stars(frame.pixels), solution=solved(frame, PLATES[2])
    )
    elsewhere = Stars.without_proper_motion(np.array([10.0]), np.array([4.0]), np.array([9.0]))
    assert KnownStars.of(field, catalogue_of_stars(elsewhere)) is None


# -- Bayes' rule -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("said", "more", "less"),
    [
        ("same light", "star chain", "satellite"),
        ("new light", "satellite", "star chain"),
        ("catalogue stars", "star chain", "satellite"),
        ("no catalogue stars", "satellite", "star chain"),
    ],
)
def test_a_comparison_moves_the_classes(said, more, less):
    after = update_probabilities(PRIOR, said)
    assert sum(after.values()) == pytest.approx(1.0)
    assert after[more] > PRIOR[more]
    assert after[less] < PRIOR[less]


def test_memory_is_one_frame():
    made, sky = FrameComparison(), sky_with(5, is_chain=False)
    path = FrameReducer(Boxed(CLOSE), SURE, Solved(PLATES), Config(), comparison=made)
    for number, wcs in PLATES.items():
        frame = sky.frame(number, wcs)
        path.reduce(frame)
        assert made.before is not None
        assert made.before.frame is frame
