"""Tuning: what is tried, what it would have done to the night, and what the engine is told."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.pilot import Pilot
from textual.widgets import Input, Static

from rsoconsole.base import ConfigError
from rsoconsole.config import Config, with_setting
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.pane_layout import THREE_COLUMNS, pane_boxes, tune_box
from rsoconsole.console.tuning.lines import TuneWords, tune_lines
from rsoconsole.console.tuning.tuning_pane import (
    TuneFigures,
    TunePane,
    Tuning,
    load_presets,
    save_preset,
)
from rsoconsole.console.words.tunable import NAMES, TUNABLES
from rsoconsole.engine import TUNABLE
from rsoconsole.night import lead_figures
from rsoconsole.pipeline import what_if
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import Miss, TrackState
from rsoconsole.session import decode, encode
from rsoconsole.tracking import Settled
from tests.rigs.engine_rig import rig
from tests.rigs.seat_rig import FakeWire, pane, play, screen_text, until

CONFIG = Config.model_validate({"search": {"recentre": "every"}})
PRESENT = {
    name: getattr(getattr(Config(), name.split(".")[0]), name.split(".")[1]) for name in NAMES
}


@pytest.fixture(scope="module")
def night() -> list:
    """Forty frames with three misses, as a session would give them back."""
    r = rig(set(range(1, 41)) - {12, 20, 21}, CONFIG)
    r.engine.arm()
    r.engine.run(frames=40)
    return [decode(*encode(record)[::2]) for record in r.memory.records]


# -- what is tried ----------------------------------------------------------------------------


def test_every_setting_of_the_pane_may_be_set_on_a_running_engine():
    assert set(NAMES) <= TUNABLE
    for tunable in TUNABLES:
        value = PRESENT[tunable.name]
        for by in (-1, 1):
            with_setting(Config(), tunable.name, tunable.step_value(value, by))


@given(st.sampled_from(TUNABLES), st.integers(-60, 60))
def test_steps_stay_within_what_the_configuration_takes(tunable, by):
    with_setting(Config(), tunable.name, tunable.step_value(PRESENT[tunable.name], by))


def test_a_step_there_and_back_is_no_trial():
    tuning = Tuning()
    tuning.see(PRESENT)
    for row, tunable in enumerate(tuning.tunables):
        tuning.row = row
        tuning.step(-1)
        assert set(tuning.changes) == {tunable.name}
        tuning.step(1)
        assert tuning.changes == {}


def test_a_number_is_typed_within_its_bounds_and_steps_go_on_from_it():
    tuning = Tuning()
    tuning.see(PRESENT)
    assert tuning.type("0.37") == ""
    assert tuning.changes == {"detector.tau": 0.37}
    tuning.step(1)
    assert tuning.changes["detector.tau"] == pytest.approx(0.37 * 1.25, rel=0.01)
    assert "between 0.01 and 0.99" in tuning.type("7")
    assert "no number" in tuning.type("much")
    assert tuning.type(str(PRESENT["detector.tau"])) == ""
    assert tuning.changes == {}


def test_what_has_been_sent_is_shown_as_sent_until_it_is_in_force():
    def said() -> str:
        lines = tune_lines(tuning, TuneFigures())(46, 24)
        return "\n".join("".join(text for text, _ in line) for line in lines)

    tuning = Tuning()
    tuning.see(PRESENT)
    tuning.type("0.37")
    assert "1 tried" in said()
    tuning.apply()
    assert "→ 0.37 sent" in said()
    assert "1 sent, from the next frame" in said()
    tuning.see(PRESENT | {"detector.tau": 0.37})
    assert "sent" not in said()


def test_log_likelihood_prefers_the_sigma_that_fits(night):
    tuned = {"filter.preset": "tuned"}
    now = what_if(night, CONFIG, tuned)
    absurd = what_if(night, CONFIG, {**tuned, "filter.r_multiplier": 400.0})
    assert now.log_likelihood_mean is not None
    assert absurd.log_likelihood_mean is not None
    assert now.log_likelihood_mean > absurd.log_likelihood_mean + 1.0
    assert track_figures([]).log_likelihood_mean is None


def test_steps_at_a_bound_need_not_be_gone_back():
    tuning = Tuning()
    tuning.see(PRESENT | {"detector.tau": 0.5})
    for _ in range(20):
        tuning.step(1)
    assert tuning.changes == {"detector.tau": 0.99}
    tuning.step(-1)
    assert tuning.changes["detector.tau"] < 0.99


def test_what_was_applied_can_be_undone_once():
    tuning = Tuning()
    tuning.see(PRESENT)
    tuning.step(1)
    wanted = tuning.apply()
    tuning.see(PRESENT | wanted)
    assert tuning.changes == {}
    assert tuning.undo() == {"detector.tau": PRESENT["detector.tau"]}
    assert tuning.undo() == {}


# -- what it would have done ------------------------------------------------------------------


def test_each_application_is_undone_by_itself_the_last_one_first():
    tuning = Tuning()
    tuning.see(PRESENT)
    for name, value in (("detector.tau", 0.2), ("filter.gate_nis", 14.0)):
        tuning.changes = {name: value}
        assert tuning.apply() == {name: value}
        tuning.see({**tuning.present, name: value})
    assert tuning.undo() == {"filter.gate_nis": PRESENT["filter.gate_nis"]}
    assert tuning.undo() == {"detector.tau": PRESENT["detector.tau"]}
    assert tuning.undo() == {}


def test_a_step_from_a_preset_starts_from_what_it_says():
    tuning = Tuning()
    tuning.see(PRESENT)
    tuning.load({"detector.tau": 0.5})
    tuning.step(1)
    assert tuning.changes == {"detector.tau": 0.625}
    tuning.step(-1)
    assert tuning.changes == {"detector.tau": 0.5}


def test_with_nothing_tried_the_figures_are_those_of_the_record(night):
    figures = what_if(night, CONFIG, {})
    updates = [r for r in night if isinstance(r, TrackState) and r.kind == "updated"]
    assert figures.updates == len(updates)
    assert figures.misses == len([r for r in night if isinstance(r, Miss)]) == 3
    assert figures.nis_mean == pytest.approx(sum(u.nis for u in updates) / len(updates))
    squares = [e**2 + n**2 for e, n in (u.innovation_arcsec for u in updates)]
    assert figures.residual_rms_arcsec == pytest.approx((sum(squares) / len(squares)) ** 0.5)
    assert figures.frames == 40
    assert figures.state == "TRACK"


def test_a_larger_r_makes_the_nis_smaller_and_the_bounds_hold_as_often(night):
    tuned = {"filter.preset": "tuned"}
    now = what_if(night, CONFIG, tuned)
    then = what_if(night, CONFIG, {**tuned, "filter.r_multiplier": 4.0})
    assert then.nis_mean < 0.5 * now.nis_mean
    assert then.inside_3sigma >= now.inside_3sigma


def test_the_pane_says_how_many_frames_its_figures_are_of(night):
    figures = what_if(night, CONFIG, {}, last=10)
    said = [
        "".join(t for t, _ in line) for line in tune_lines(Tuning(), TuneFigures(figures))(46, 24)
    ]
    assert sum("last 10 frames" in line for line in said) == 1


def test_only_the_last_frames_are_looked_at_where_that_is_asked(night):
    assert what_if(night, CONFIG, {}, last=10).frames == 10
    assert what_if(night, CONFIG, {}, last=10).misses == 0
    assert track_figures([]).frames == 0
    assert track_figures([]).residual_rms_arcsec is None
    assert track_figures([]).is_nis_sound is None


# -- kept by name -----------------------------------------------------------------------------


def test_a_preset_is_kept_and_read_again(tmp_path: Path):
    path = tmp_path / "deep" / "presets.toml"
    assert load_presets(path) == {}
    save_preset(path, "thin cloud", {"detector.tau": 0.05, "filter.preset": "tuned"})
    save_preset(path, "bright", PRESENT)
    save_preset(path, "thin cloud", {"detector.tau": 0.04, "filter.sigma_arcsec": None})
    assert load_presets(path) == {"thin cloud": {"detector.tau": 0.04}, "bright": PRESENT}


@pytest.mark.parametrize("name", ["", "a\nb", '"', "x" * 60])
def test_a_name_that_cannot_be_is_refused(tmp_path: Path, name: str):
    with pytest.raises(ConfigError, match="no name for a preset"):
        save_preset(tmp_path / "presets.toml", name, PRESENT)


@pytest.mark.parametrize("text", ["[a", '[a]\n"site.latitude_deg" = 3', "a = 3"])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str):
    path = tmp_path / "presets.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"presets\.toml"):
        load_presets(path)


# -- the pane ---------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 60), (60, 16), (40, 12)])
def test_the_pane_has_a_place_in_every_terminal_and_leaves_state_keys_and_plots(size):
    box, boxes = tune_box(*size), pane_boxes(*size)
    assert box.x + box.width <= size[0]
    assert box.y >= boxes["top"].height
    assert box.y + box.height <= size[1] - 1
    if 80 <= size[0] < THREE_COLUMNS[0]:
        # The plots stay beside it, a little narrower in the smallest terminal.
        assert box.x + box.width <= boxes["confidence"].x + 4
    if size[0] >= THREE_COLUMNS[0]:
        assert box.y >= boxes["sky"].y + boxes["sky"].height


def test_the_pane_says_what_is_in_force_and_what_is_tried():
    tuning = Tuning()
    tuning.see(PRESENT)
    tuning.step(1)
    lines = tune_lines(tuning, TuneFigures())(46, 24)
    text = "\n".join("".join(part for part, _ in line) for line in lines)
    assert len(lines) == 24
    assert "▸ τ" in text
    assert "→ 0.125" in text
    assert "1 tried" in text
    for tunable in tuning.tunables:
        assert tunable.label in text


@pytest.mark.parametrize(
    ("preset", "own"), [("adaptive", set()), ("tuned", {"q"}), ("paper", {"σ"})]
)
def test_only_what_has_a_part_with_the_preset_is_offered(preset: str, own: set[str]):
    tuning = Tuning()
    tuning.see(PRESENT | {"filter.preset": preset})
    assert {t.label for t in tuning.tunables} & {"σ", "q"} == own
    assert {t.name for t in TUNABLES if t.preset is None} <= {t.name for t in tuning.tunables}


def test_what_a_tried_preset_does_not_ask_for_is_tried_no_longer():
    tuning = Tuning()
    tuning.see(PRESENT | {"filter.preset": "tuned"})
    names = [t.name for t in tuning.tunables]
    tuning.row = names.index("filter.q_arcsec2_s3")
    tuning.step(1)
    tuning.row = names.index("filter.preset")
    tuning.step(1)
    assert tuning.changes == {"filter.preset": "paper"}


def test_the_pane_says_where_and_when_the_filter_settles():
    told = track_figures(())
    now = replace(told, log_likelihood_mean=-1.0)
    then = replace(told, log_likelihood_mean=-0.5)
    in_force = Settled(
        sigma_innovation_arcsec=(0.5, 0.2),
        sigma_predicted_arcsec=(0.3, 0.1),
        gain=(0.15, 0.26),
        updates=1,
    )
    tried = replace(in_force, sigma_innovation_arcsec=(63.0, 2.0), gain=(0.4, 0.614), updates=54)
    tuning = Tuning()
    tuning.see(PRESENT)
    tuning.step(1)
    figures = TuneFigures(now, then, in_force, tried)
    words = TuneWords(aims_by_orbit=True, learnt="learnt: Q ×0.2")
    lines = tune_lines(tuning, figures, words=words)(36, 24)
    texts = ["".join(part for part, _ in line) for line in lines]
    assert "  bounds 3σ       1.5 .6″   3.15 .1′" in texts
    assert "  gain RA δ       .15 .26    .40 .61" in texts
    assert "  after           1 frame  54 frames" in texts
    assert " learnt: Q ×0.2" in texts
    assert any("the orbit aims" in row for row in texts)
    assert any(row.startswith("  log L ↑") and row.endswith("-0.50") for row in texts)
    labels = [row[3:].split()[0] for row in texts[1:4]]
    assert labels == ["τ", "Q", "R"]  # first, and seen in the smallest pane


def test_the_bounds_if_tried_are_those_of_the_lead_frame_by_frame():
    r = rig(set(range(1, 8)))
    r.engine.arm()
    r.engine.run(frames=9)
    figures, newest = lead_figures(r.memory.records, r.engine.config)
    sigmas = {
        s.frame_id: s.sigma_innovation_arcsec
        for s in r.memory.of(TrackState)
        if s.kind == "updated"
    }
    assert len(sigmas) > 3
    assert {frame: figures.lead_sigmas_arcsec[frame] for frame in sigmas} == sigmas
    assert newest.update.updated.frame_id in sigmas
    assert newest.cadence_s > 0.0


@pytest.mark.parametrize("height", [12, 17, 21])
def test_in_a_lower_pane_the_settings_move_so_that_the_chosen_one_is_seen(height: int):
    tuning = Tuning()
    tuning.see(PRESENT)
    for row, tunable in enumerate(tuning.tunables):
        tuning.row = row
        lines = tune_lines(tuning, TuneFigures())(41, height)
        texts = ["".join(part for part, _ in line) for line in lines]
        assert len(texts) == height
        assert [text for text in texts if "▸" in text and tunable.label in text]
        is_whole = sum(any(t.label in x for x in texts) for t in tuning.tunables) == len(
            tuning.tunables
        )
        assert any(text.startswith(" ▲") for text in texts) or row < height // 2 or is_whole
        assert any(text.startswith(" ▼") for text in texts) or row > 2 or is_whole
        assert "as it was" in "".join(texts)


def test_what_is_tried_is_shown_then_applied_then_undone(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t")
        await until(pilot, lambda: "as it was" in pane(app, "tune"))
        await pilot.press("right", "right")
        assert "→ 0.156" in pane(app, "tune")
        await until(pilot, lambda: "…" not in pane(app, "tune"))
        assert "misses" in pane(app, "tune")
        assert wire.verbs == []
        await pilot.press("enter")
        await until(pilot, lambda: wire.verbs == ["set"])
        assert wire.sent[0][1] == {"name": "detector.tau", "value": 0.156}
        await pilot.press("u")
        await until(pilot, lambda: wire.verbs == ["set", "set"])
        assert wire.sent[1][1] == {"name": "detector.tau", "value": 0.1}
        await pilot.press("escape")
        await pilot.pause()
        assert not app.live.query_one("#tune", TunePane).display
        assert "residual" in screen_text(app)

    play(wire, scene)


def test_all_settings_that_were_applied_or_undone_together_are_named(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t")
        await until(pilot, lambda: "as it was" in pane(app, "tune"))
        await pilot.press("right", "down", "right", "enter")
        await until(pilot, lambda: wire.verbs == ["set", "set"])
        await until(pilot, lambda: all(n in pane(app, "keys") for n in ("τ 0.1 → ", "Q× 1 → ")))
        await pilot.press("u")
        await until(pilot, lambda: wire.verbs == ["set"] * 4)
        said = ("→ 0.1 ", "→ 1 ")
        await until(pilot, lambda: all(n in pane(app, "keys") for n in said))

    play(wire, scene)


def test_help_explains_the_pane_that_has_the_keys(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "f1")
        await until(pilot, lambda: app.screen is not app.live)
        first = str(app.screen.query_one(Static).render()).splitlines()[:4]
        assert first[0] == "Now: the tuning pane"
        assert "Choose" in first[1]
        await pilot.press("escape", "escape", "f1")
        await until(pilot, lambda: app.screen is not app.live)
        assert str(app.screen.query_one(Static).render()).startswith("Safety")

    play(wire, scene)


def test_what_is_tried_may_hold_for_some_frames_only(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "f")
        assert "nothing is tried" in pane(app, "keys")
        await pilot.press("left", "f")
        await until(pilot, lambda: app.screen is not app.live)
        field = app.screen.query_one(Input)
        field.value = "none"
        await pilot.press("enter")
        assert "is no number of frames" in pane(app, "keys")
        await pilot.press("f")
        await until(pilot, lambda: app.screen is not app.live)
        app.screen.query_one(Input).value = "3"
        await pilot.press("enter")
        await until(pilot, lambda: wire.verbs == ["set"])
        assert wire.sent[0][1] == {"name": "detector.tau", "value": 0.08, "frames": 3}

    play(wire, scene)


def test_stop_works_while_one_tunes_and_arrows_do_not_nudge(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "down", "left", "up")
        assert wire.verbs == []
        await pilot.press("x")
        await until(pilot, lambda: wire.verbs == ["stop"])

    play(wire, scene)


def test_q_and_r_are_proposed_from_the_pane(wire: FakeWire):
    """The measurements of the made-up night have no error: a smaller R is put on trial."""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "p")
        assert "seeking the likeliest Q and R" in pane(app, "keys")
        await until(pilot, lambda: "proposal: " in pane(app, "keys"))
        assert app.live.tune.tuning.changes["filter.r_multiplier"] < 0.01
        assert "tried" in pane(app, "tune")

    play(wire, scene)


def test_a_preset_is_saved_and_loaded_from_the_pane(
    wire: FakeWire, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "config.toml"))

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "o")
        assert "no preset" in pane(app, "keys")
        await pilot.press("down", "down", "down", "right", "right", "w")
        await until(pilot, lambda: app.screen is not app.live)
        await pilot.press(*"bad", "enter")
        await until(pilot, lambda: app.screen is app.live)
        assert "preset 'bad' is kept" in pane(app, "keys")
        assert load_presets(tmp_path / "presets.toml")["bad"]["filter.preset"] == "paper"
        await pilot.press("left", "left", "o")
        await until(pilot, lambda: app.screen is not app.live)
        await pilot.press(*"bad", "enter")
        await until(pilot, lambda: "→ paper" in pane(app, "tune"))

    play(wire, scene)


def test_a_seat_that_only_looks_may_try_and_not_apply(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "right", "enter")
        await until(pilot, lambda: "only looks" in pane(app, "keys"))
        assert wire.verbs == []

    play(wire, scene, read_only=True)


def test_a_figure_on_the_keyboard_begins_a_number_for_the_chosen_setting(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("t")
        await until(pilot, lambda: isinstance(app.focused, TunePane))
        await pilot.press("0")
        await until(pilot, lambda: isinstance(app.focused, Input))
        await pilot.press(*".25", "enter")
        await until(pilot, lambda: "→ 0.25" in pane(app, "tune"))
        # Nothing is under way that would draw it again.
        await until(pilot, lambda: app.live.tune.figures[1] is not None)
        await pilot.press("enter")
        await until(pilot, lambda: ("set", {"name": "detector.tau", "value": 0.25}) in wire.sent)
        await until(pilot, lambda: "sent" in pane(app, "tune"))

    play(wire, scene)


def test_beside_the_open_pane_plots_figures_and_log_are_seen(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        live = app.live
        facts, tune = live.query_one("#facts"), live.query_one("#tune")
        wide = facts.size.width
        await pilot.press("t")
        await until(pilot, lambda: facts.size.width < wide)
        for name in ("facts", "log", "confidence", "east", "north"):
            assert live.query_one(f"#{name}").region.x > tune.region.right - 1
        await pilot.press("escape")
        await until(pilot, lambda: facts.size.width == wide)

    play(wire, scene, (100, 30))


def test_what_the_engine_took_of_a_setting_is_said_with_both_values(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "right", "enter")
        await until(pilot, lambda: "τ 0.1 → 0.125 from the next frame" in pane(app, "keys"))

    play(wire, scene, (100, 30))
