"""A wrong hint is no cloud: the field is solved without it, and it is named."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.instruments import PlateSolver, SolveHint
from rsoconsole.instruments.solver import index_files
from rsoconsole.pipeline.frame.hints import (
    header_hint,
    hint_with_overrides,
    relaxed_hints,
    wrong_hints,
)
from rsoconsole.pipeline.frame.plate import PlateFinder
from rsoconsole.records import CameraMode, FloatArray, Frame, NotSolved, Solution
from rsoconsole.sky import separation_deg
from tests.drawn.plate_fields import HEIGHT, SCALE, WIDTH, belt_plate, belt_stars

CONFIG = Config()
HALF_ARCSEC = 0.5
RA_DEG, DEC_DEG = 40.0, 2.0


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlateSolver]:
    """With nothing but the shipped index files."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(index_files, "SYSTEM_DIR", Path("/nonexistent"))
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))
        with PlateSolver() as plate_solver:
            yield plate_solver


@pytest.fixture(scope="module")
def stars() -> FloatArray:
    return belt_stars(belt_plate(RA_DEG, DEC_DEG))


def frame(
    scale: float | None = SCALE, ra_deg: float | None = RA_DEG, dec_deg: float | None = DEC_DEG
) -> Frame:
    """What a driver says that believes in this scale and direction."""
    focal_length = {} if scale is None else {"FOCALLEN": 620.0 * SCALE / scale}
    return Frame(
        frame_id=3,
        name="a.fits",
        pixels=np.broadcast_to(np.uint16(0), (HEIGHT, WIDTH)),
        scale_arcsec_px=scale,
        pointing_ra_icrs_deg=ra_deg,
        pointing_dec_icrs_deg=dec_deg,
        header=focal_length,
    )


def expect_right(found: Solution | NotSolved) -> Solution:
    assert isinstance(found, Solution), found
    off_deg = separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, RA_DEG, DEC_DEG)
    assert 3600.0 * off_deg < HALF_ARCSEC
    return found


def named(of: Frame, found: Solution) -> dict[str, str]:
    wrong = wrong_hints(header_hint(of, CONFIG), found, of, CONFIG)
    return {each.hint: each.words for each in wrong}


def test_right_hints_are_not_complained_of(solver, stars):
    found = expect_right(PlateFinder(solver, CONFIG).solve(frame(), stars))
    assert named(frame(), found) == {}


@pytest.mark.parametrize("factor", [2.0, 0.5, 1.2])
def test_a_wrong_scale_is_named_with_the_right_one_and_its_remedy(solver, stars, factor):
    believed = frame(factor * SCALE)
    found = expect_right(PlateFinder(solver, CONFIG).solve(believed, stars))
    words = named(believed, found)
    assert set(words) == {"scale"}
    assert f"{factor * SCALE:.4g} arcsec/px is wrong: the stars say 1.264" in words["scale"]
    assert "it should be 620" in words["scale"]


def test_a_scale_that_is_the_configurations_is_called_so(solver, stars):
    wrong = Config.model_validate({"optics": {"focal_length_mm": 310.0}})
    believed = frame(2.0 * SCALE)
    found = expect_right(PlateFinder(solver, wrong).solve(believed, stars))
    (hint,) = wrong_hints(header_hint(believed, wrong), found, believed, wrong)
    assert hint.words.startswith("the configured scale 2.528 arcsec/px is wrong")
    assert "optics.focal_length_mm" in hint.words


def test_a_wrong_position_is_named_with_how_far_it_is_off(solver, stars):
    believed = frame(ra_deg=90.0)
    found = expect_right(PlateFinder(solver, CONFIG).solve(believed, stars))
    words = named(believed, found)
    assert set(words) == {"position"}
    # At two degrees of declination the parallel is all but a great circle.
    assert "50.0 deg away" in words["position"]


def test_both_hints_may_be_wrong(solver, stars):
    believed = frame(3.0 * SCALE, 90.0)
    found = expect_right(PlateFinder(solver, CONFIG).solve(believed, stars))
    assert set(named(believed, found)) == {"scale", "position"}


def test_what_an_operator_gave_is_called_given(solver, stars):
    hint = hint_with_overrides(header_hint(frame(None), CONFIG), None, None, None, (5.0, 6.0))
    found = expect_right(PlateFinder(solver, CONFIG).solve_in_full(frame(None), stars, hint))
    (wrong,) = wrong_hints(hint, found, frame(None), CONFIG)
    assert wrong.words == "the given scale of 5 to 6 arcsec/px is wrong: the stars say 1.264"


def test_a_field_that_matches_nothing_keeps_the_first_reason_and_the_deadline(solver):
    rng = np.random.default_rng(0)
    nothing = np.column_stack([rng.uniform((0, 0), (WIDTH, HEIGHT), (60, 2)), np.arange(60.0)])
    hurried = Config.model_validate({"solver": {"deadline_s": 4.0}})
    began_s = time.monotonic()
    found = PlateFinder(solver, hurried).solve(frame(), nothing)
    assert isinstance(found, NotSolved)
    assert "within 3 deg of RA 40.000" in found.reason
    # The deadline, and as much again for a process that has to be replaced on a busy machine.
    assert time.monotonic() - began_s < 8.0
    assert found.ms >= 0.0


def test_a_wrong_focal_length_costs_one_search_not_one_a_frame(solver, stars):
    finder = PlateFinder(solver, CONFIG)
    expect_right(finder.solve(frame(2.0 * SCALE), stars))
    finder.forget()
    asked: list[SolveHint] = []
    attempt = solver.solve
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            solver, "solve", lambda *a, **more: (asked.append(more["hint"]), attempt(*a, **more))[1]
        )
        expect_right(finder.solve(frame(2.0 * SCALE), stars))
    (hint,) = asked
    low, high = hint.scale_arcsec_px
    assert low < SCALE < high


class CountedSolver:
    """Solves nothing and remembers what it was asked."""

    def __init__(self) -> None:
        self.hints: list[SolveHint] = []
        self.deadlines_s: list[float] = []

    def solve(
        self, stars: FloatArray, *, hint: SolveHint, deadline_s: float, **_: object
    ) -> NotSolved:
        self.hints.append(hint)
        self.deadlines_s.append(deadline_s)
        return NotSolved(frame_id=3, reason="no match", ms=1.0)


def test_a_cloud_does_not_have_the_whole_sky_searched_at_every_frame(stars):
    solver = CountedSolver()
    finder = PlateFinder(solver, CONFIG)
    searches = []
    for _ in range(10):
        before = len(solver.hints)
        finder.solve(frame(), stars)
        searches.append(len(solver.hints) - before)
    assert searches == [4, 4, 1, 4, 1, 1, 1, 4, 1, 1]


@pytest.mark.parametrize(
    ("share", "searches"), [(0.3, [1, 1, 1, 4, 1]), (1.0, [4, 4, 1, 4, 1])], ids=["cloud", "lost"]
)
def test_hints_that_held_are_doubted_at_once_only_where_the_stars_are_there(
    solver, stars, share, searches
):
    finder = PlateFinder(solver, CONFIG)
    expect_right(finder.solve(frame(), stars))
    rng = np.random.default_rng(0)
    places = rng.uniform((0, 0), (WIDTH, HEIGHT), (int(share * len(stars)), 2))
    nothing = np.column_stack([places, np.arange(float(len(places)), 0.0, -1.0)])
    asked: list[SolveHint] = []

    def solves_nothing(*_: object, hint: SolveHint, **__: object) -> NotSolved:
        asked.append(hint)
        return NotSolved(frame_id=3, reason="no match", ms=1.0)

    counts = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver, "solve", solves_nothing)
        for _ in searches:
            asked.clear()
            finder.solve(frame(), nothing)
            counts.append(len(asked))
    assert counts == searches


def test_frames_without_a_position_have_the_long_deadline_ever_more_rarely(stars):
    solver = CountedSolver()
    finder = PlateFinder(solver, CONFIG)
    longest_s = []
    for _ in range(10):
        solver.deadlines_s.clear()
        finder.solve(frame(ra_deg=None, dec_deg=None), stars)
        longest_s.append(solver.deadlines_s[0])
    long_s, short_s = CONFIG.solver.blind_deadline_s, CONFIG.solver.deadline_s
    assert [n for n, s in enumerate(longest_s, start=1) if s == long_s] == [1, 2, 4, 8]
    assert set(longest_s) == {long_s, short_s}


class EndlessSolver:
    """Takes all the time it is given, and solves nothing."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def solve(self, stars: FloatArray, *, deadline_s: float, **_: object) -> NotSolved:
        self.now_s += deadline_s
        return NotSolved(frame_id=3, reason="no match", ms=1.0)


@pytest.mark.parametrize("ra_deg", [RA_DEG, None])
@pytest.mark.parametrize("scale", [SCALE, None])
def test_all_searches_for_a_hopeless_frame_together_keep_its_deadline(
    stars, scale, ra_deg, monkeypatch
):
    solver = EndlessSolver()
    monkeypatch.setattr(
        "rsoconsole.pipeline.frame.plate.time", SimpleNamespace(monotonic=lambda: solver.now_s)
    )
    finder = PlateFinder(solver, CONFIG)
    for number in range(1, 17):
        before_s = solver.now_s
        finder.solve(frame(scale, ra_deg), stars)
        is_long = ra_deg is None and number in (1, 2, 4, 8, 16)
        settings = CONFIG.solver
        most_s = settings.blind_deadline_s if is_long else settings.deadline_s
        assert solver.now_s - before_s <= most_s


def test_too_few_stars_are_not_searched_for_elsewhere(stars):
    solver = CountedSolver()
    PlateFinder(solver, CONFIG).solve(frame(), stars[:7])
    assert len(solver.hints) == 1


def test_a_hint_is_weakened_step_by_step_and_nothing_is_tried_twice():
    whole = header_hint(frame(), CONFIG)
    assert [
        (h.scale_low_arcsec_px is None, h.position_deg is None) for h in relaxed_hints(whole)
    ] == [
        (True, False),
        (False, True),
        (True, True),
    ]
    assert len(relaxed_hints(header_hint(frame(scale=None), CONFIG))) == 1
    assert len(relaxed_hints(header_hint(frame(ra_deg=None, dec_deg=None), CONFIG))) == 1
    assert relaxed_hints(SolveHint()) == ()


@pytest.mark.parametrize(
    ("side_px", "says", "missing"),
    [
        # 8 arcmin: quads of 2.8 to 8 arcmin, as astrometry.net numbers its series.
        (380, "5201, 5202, 5203", (1, 2, 3)),
        (1330, "5205, 5206", (5, 6, 7)),
    ],
)
def test_a_small_field_is_told_which_index_files_it_wants(solver, stars, side_px, says, missing):
    hint = SolveHint(
        ra_icrs_deg=RA_DEG,
        dec_icrs_deg=DEC_DEG,
        scale_low_arcsec_px=0.95 * SCALE,
        scale_high_arcsec_px=1.05 * SCALE,
    )
    middle = stars[:, :2] - (WIDTH / 2, HEIGHT / 2)
    inside = (np.abs(middle) < side_px / 2).all(axis=1)
    few = np.column_stack([middle[inside] + side_px / 2, stars[inside, 2]])
    # Whatever the sky has there: enough to be searched for.
    rng = np.random.default_rng(1)
    more = np.column_stack([rng.uniform(0, side_px, (12, 2)), np.full(12, few[:, 2].min())])
    found = solver.solve(
        np.concatenate([few, more]),
        frame_id=1,
        width_px=side_px,
        height_px=side_px,
        hint=hint,
        deadline_s=10.0,
    )
    assert isinstance(found, NotSolved)
    assert says in found.reason
    assert "data.astrometry.net" in found.reason
    assert solver.missing_numbers_for_field(hint, side_px, side_px) == missing


def test_without_a_scale_it_is_said_that_it_is_not_known(solver, stars):
    rng = np.random.default_rng(1)
    few = np.column_stack([rng.uniform(0, 400, (12, 2)), np.arange(12.0)])
    found = solver.solve(
        few, frame_id=1, width_px=400, height_px=400, hint=SolveHint(), deadline_s=20.0
    )
    assert isinstance(found, NotSolved)
    assert "finer index files than 4108" in found.reason
    assert solver.missing_numbers_for_field(SolveHint(), 400, 400) == ()


def part_of(whole: Frame, x0: int, y0: int, width: int, height: int, **camera: Any) -> Frame:
    return replace(
        whole,
        pixels=np.broadcast_to(np.uint16(0), (height, width)),
        camera=CameraMode(**{"binning": "1x1", "x0_px": x0, "y0_px": y0, **camera}),
    )


def stars_in(stars: FloatArray, x0: int, y0: int, width: int, height: int) -> FloatArray:
    x, y = stars[:, 0] - x0, stars[:, 1] - y0
    is_in = (x > 0) & (x < width - 1) & (y > 0) & (y < height - 1)
    return np.column_stack([x, y, stars[:, 2:]])[is_in]


def test_the_last_plate_serves_for_a_part_of_the_sensor_and_back(solver, stars):
    """Where headers say where it lies; else the part is solved as any other frame."""
    window = (WIDTH // 4, HEIGHT // 4, WIDTH // 2, HEIGHT // 2)
    whole = replace(frame(), camera=CameraMode(binning="1x1"))
    finder = PlateFinder(solver, CONFIG)
    assert expect_right(finder.solve(whole, stars)).path == "full"
    inner = stars_in(stars, *window)
    assert expect_right(finder.solve(part_of(whole, *window), inner)).path == "refit"
    assert expect_right(finder.solve(whole, stars)).path == "refit"
    silent = part_of(whole, *window, x0_px=None, y0_px=None)
    assert expect_right(finder.solve(silent, inner)).path == "full"
