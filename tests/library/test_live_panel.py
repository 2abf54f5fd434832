"""The live panel without a browser: what its page is told, and what comes of what it asks."""

import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

pytest.importorskip("anywidget", reason="needs rsoconsole[notebook]: anywidget is missing")

from rsoconsole.control import Found, Outcome, Sender
from rsoconsole.library.notebook.panel import link, panel
from rsoconsole.library.notebook.panel.panel import LivePanel
from rsoconsole.records import Event
from rsoconsole.session import SessionWriter
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import ANSWERED, FRAMES, FakeWire

PATIENCE_S = 20.0
STATIC = Path(panel.__file__).parents[1] / "static"
PREVIEW = {
    "ra_icrs_deg": 150.0,
    "dec_icrs_deg": -5.0,
    "ra_date_deg": 150.3,
    "dec_date_deg": -5.1,
    "alt_deg": 41.0,
    "az_deg": 170.0,
    "way_deg": 3.2,
    "slew_s": 4.0,
    "margins_deg": [["altitude", 26.0]],
    "refused": None,
}


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "EVERY_S", 0.02)


@pytest.fixture
def told(wire: FakeWire) -> FakeWire:
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)
    return wire


@pytest.fixture
def opened(told: FakeWire, monkeypatch: pytest.MonkeyPatch) -> Iterator[LivePanel]:
    yield from shown(told, monkeypatch)


@pytest.fixture
def looking(told: FakeWire, monkeypatch: pytest.MonkeyPatch) -> Iterator[LivePanel]:
    yield from shown(told, monkeypatch, read_only=True)


def shown(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch, *, read_only: bool = False
) -> Iterator[LivePanel]:
    """A panel whose page has spoken; past the engine there is a mount that stands."""
    past: list[Any] = []

    def stop_past_engine(on_found: Callable[[Found], None], indi: Any) -> None:
        past.append(indi)
        found = {"is_answered": True, "path": "indi"}
        on_found(found)
        on_found(found | {"motion": "stands"})

    monkeypatch.setattr(panel, "stop_without_engine", stop_past_engine)
    made = LivePanel(wire=wire, read_only=read_only)
    made.past = past
    page(made, "here")
    until(lambda: made.status.get("reach") == "attached" and made.night)
    yield made
    made.close()
    assert not made.is_running


def page(made: LivePanel, kind: str, **more: Any) -> None:
    """What its page says."""
    made._receive(made, {"kind": kind, **more}, None)


def until(is_so: Callable[[], Any]) -> Any:
    ends_s = time.monotonic() + PATIENCE_S
    while not (found := is_so()):
        assert time.monotonic() < ends_s, "it never came to be"
        time.sleep(0.01)
    return found


# -- what is shown ---------------------------------------------------------------------------


def test_the_engine_is_told_in_words(opened: LivePanel, told: FakeWire) -> None:
    status = opened.status
    assert (status["state"], status["holder"]) == ("TRACK", "autonomy has the mount")
    assert ["next limit", "pier in 52 min"] in status["facts"]
    assert ["disk", False, "4 GB, 2 h"] in status["health"]
    told.status |= {"faults": ["camera is silent"], "lifted": ["sun"]}
    until(lambda: opened.status["alerts"] == ["FAULT camera is silent", "overridden: sun"])


def test_the_record_is_told_with_its_plots_and_its_picture(opened: LivePanel) -> None:
    shown = opened.night
    assert opened.picture.startswith(b"\x89PNG")
    assert f"frame {FRAMES:04d}" in shown["caption"]
    confidence, east = (
        ElementTree.fromstring(shown["plots"][name]) for name in ("confidence", "east")
    )
    # 17 measured (3 to 20 but 12), of which the first makes no track, and one missed.
    titles = [t.text for t in confidence.iter("title")]
    assert len([t for t in titles if "no detection" in t]) == 1
    assert len(titles) == 17
    assert len(list(east.iter("circle"))) == 15
    assert ElementTree.fromstring(shown["overlay"]).find("rect") is not None
    assert any("COAST: no detection" in line[2] for line in shown["log"])
    assert {n: v for n, _, _, v, _ in shown["tunables"]}["detector.tau"] == 0.1


def test_what_is_new_on_record_is_shown(writer: SessionWriter, opened: LivePanel) -> None:
    evil = "<script>alert(1)</script>\x1b[2J"
    writer.append(Event(level="alarm", text=evil), night.t_of(FRAMES))
    night.add_frames(writer, range(FRAMES + 1, FRAMES + 3))
    until(lambda: any("script" in line[2] for line in opened.night["log"]))
    assert all("\x1b" not in line[2] for line in opened.night["log"])
    until(lambda: f"frame {FRAMES + 2}" in opened.night["plots"]["confidence"])
    # The newest picture is still that of frame 20; what is said beside it is of that frame.
    assert f"frame {FRAMES:04d}" in opened.night["caption"]


def test_all_that_is_told_is_json(opened: LivePanel) -> None:
    for value in (opened.status, opened.night):
        json.dumps(value, allow_nan=False)


def test_an_engine_that_vanishes_is_shown_and_comes_back(opened: LivePanel, told: FakeWire) -> None:
    told.is_gone = True
    until(lambda: opened.status["reach"] == "gone")
    assert "no engine is running" in opened.status["detail"]
    assert opened.status["state"] == "TRACK"
    told.is_gone = False
    until(lambda: opened.status["reach"] == "attached")


def test_a_session_that_cannot_be_read_is_said_and_the_engine_shown(
    told: FakeWire, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    told.status["session"] = str(tmp_path / "nowhere")
    made = LivePanel(wire=told)
    page(made, "here")
    until(lambda: "does not exist" in made.status.get("detail", ""))
    assert made.status["state"] == "TRACK"
    made.close()


# -- STOP ------------------------------------------------------------------------------------


def test_stop_goes_to_the_engine(opened: LivePanel, told: FakeWire) -> None:
    page(opened, "stop", press="a")
    until(lambda: opened.stop_news.get("phase") == "stopped")
    assert told.verbs == ["stop"]
    assert opened.stop_news["text"].startswith("the mount tracks, measured in ")


def test_a_stop_is_answered_and_then_measured(opened: LivePanel, told: FakeWire) -> None:
    told.outcomes["stop"] = Outcome(ok=True, data=ANSWERED)
    told.status["last_stop"] = {"number": 1, "motion": None}
    page(opened, "stop", press="a")
    until(lambda: opened.stop_news.get("phase") == "answered")
    assert opened.stop_news["text"].endswith("ms by the mount's own process: measuring")
    told.status["last_stop"] = {"number": 1, "motion": "moves", "rate_deg_s": 0.5}
    until(lambda: opened.stop_news.get("phase") == "failed")
    assert opened.stop_news["text"].startswith("the mount STILL MOVES at 0.5 deg/s")


def test_another_order_ends_a_stop_that_is_being_measured_and_is_no_alarm(
    opened: LivePanel, told: FakeWire
) -> None:
    told.outcomes["stop"] = Outcome(ok=True, data=ANSWERED)
    superseded = {"number": 1, "motion": "unknown", "is_over": True, "is_superseded": True}
    told.status["last_stop"] = superseded
    page(opened, "stop", press="a")
    until(lambda: "another order came" in opened.said.get("text", ""))
    assert opened.stop_news == {}


def test_a_stop_that_the_page_repeats_is_one_stop(opened: LivePanel, told: FakeWire) -> None:
    for press in ("a", "a", "b", "a"):
        page(opened, "stop", press=press)
    until(lambda: opened.stop_news == opened.stop_news | {"number": 2, "phase": "stopped"})
    assert told.verbs == ["stop", "stop"]


@pytest.mark.parametrize("trouble", ["gone", "hangs"])
def test_stop_goes_past_an_engine_that_does_not_answer(
    opened: LivePanel, told: FakeWire, trouble: str
) -> None:
    told.is_gone = trouble == "gone"
    if trouble == "hangs":
        told.hangs["stop"] = threading.Event()
    texts: list[str] = []
    opened.observe(lambda change: texts.append(change["new"].get("text", "")), "stop_news")
    begun_s = time.monotonic()
    opened.stop()
    until(lambda: opened.stop_news.get("phase") == "stopped")
    assert "by a connection past the engine" in texts[-2]
    assert texts[-1].startswith("the mount stands, measured in ")
    # As the session says how its instruments are reached; half a second is what lateness costs.
    assert [indi.mount for indi in opened.past] == ["Telescope Simulator"]
    assert time.monotonic() - begun_s < 2.0
    for event in told.hangs.values():
        event.set()


def test_stop_works_while_another_order_hangs_and_has_the_last_word(
    opened: LivePanel, told: FakeWire
) -> None:
    told.hangs["hold"] = threading.Event()
    page(opened, "order", verb="hold", arguments={})
    until(lambda: "hold" in told.verbs)
    page(opened, "stop", press="a")
    until(lambda: opened.stop_news.get("phase") == "stopped")
    said = opened.said
    told.hangs["hold"].set()
    time.sleep(0.1)
    assert opened.said == said


def test_stop_works_read_only_and_nothing_else_does(looking: LivePanel, told: FakeWire) -> None:
    for verb in ("arm", "hold", "set"):
        page(looking, "order", verb=verb, arguments={})
    page(looking, "goto", text="150 -5")
    until(lambda: "read only" in looking.said.get("text", ""))
    page(looking, "stop", press="a")
    until(lambda: looking.stop_news.get("phase") == "stopped")
    assert told.verbs == ["stop"]


def test_stop_puts_away_what_is_asked(opened: LivePanel, told: FakeWire) -> None:
    told.outcomes["hold"] = Outcome(ok=False, message="no", data={"seat": "ann@tty1"})
    page(opened, "order", verb="hold", arguments={})
    until(lambda: opened.asked.get("kind") == "seat")
    page(opened, "stop", press="a")
    assert opened.asked == {}


# -- orders ----------------------------------------------------------------------------------


def test_orders_go_by_the_wire_and_their_outcome_is_said(opened: LivePanel, told: FakeWire) -> None:
    told.outcomes["resume"] = Outcome(ok=False, message="there is nothing to resume")
    page(opened, "order", verb="hold", arguments={})
    until(lambda: opened.said == {"text": "hold: done", "level": "good"})
    page(opened, "order", verb="resume", arguments={})
    until(lambda: opened.said.get("text") == "resume: not done, there is nothing to resume")
    page(opened, "order", verb="shutdown", arguments={})  # not from here
    page(opened, "nonsense")
    assert told.verbs == ["hold", "resume"]


def test_a_refused_arming_asks_for_the_failed_checks(opened: LivePanel, told: FakeWire) -> None:
    checks = [
        {"name": "clock", "ok": True, "detail": "", "remedy": ""},
        {"name": "disk", "ok": False, "detail": "2 GB", "remedy": "make room"},
    ]
    told.outcomes["arm"] = Outcome(ok=False, message="not armed", data={"checks": checks})
    page(opened, "order", verb="arm", arguments={})
    until(lambda: opened.asked.get("kind") == "arm")
    assert [check["name"] for check in opened.asked["checks"]] == ["disk", "pointing"]
    told.outcomes["arm"] = Outcome(ok=True, message="armed")
    page(opened, "order", verb="arm", arguments={"override": ["disk"]})
    until(lambda: opened.said.get("level") == "good")
    assert opened.asked == {}
    assert told.sent[-1] == ("arm", {"override": ["disk"]})


def test_another_seat_is_named_and_can_be_asked_for(opened: LivePanel, told: FakeWire) -> None:
    told.outcomes["hold"] = Outcome(ok=False, message="no", data={"seat": "ann@tty1"})
    page(opened, "order", verb="hold", arguments={})
    until(lambda: opened.asked == {"kind": "seat", "holder": "ann@tty1"})
    page(opened, "order", verb="ask_seat", arguments={})
    until(lambda: told.verbs == ["hold", "ask_seat"])
    told.status |= {"seat": Sender.at(f"notebook-{os.getpid()}").name, "seat_asked_by": "ann@tty1"}
    until(lambda: opened.status["seat"]["asker"] == "ann@tty1")


def test_go_to_is_understood_previewed_and_only_then_sent(
    opened: LivePanel, told: FakeWire
) -> None:
    page(opened, "goto_preview", text="150 -5", number=1)
    until(lambda: opened.goto.get("may_go"))
    assert "RA and Dec, ICRS, in degrees" in opened.goto["lines"]
    assert told.sent == [("preview", {"ra_icrs_deg": 150.0, "dec_icrs_deg": -5.0})]
    page(opened, "goto", text="150 -5")
    until(lambda: told.verbs == ["preview", "goto"])
    assert told.sent[-1][1] == {"ra_icrs_deg": 150.0, "dec_icrs_deg": -5.0}


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (Outcome(ok=True, data=PREVIEW | {"refused": "altitude 3 deg"}), "REFUSED  altitude 3 deg"),
        (Outcome(ok=True, data={}), "cannot be read"),
        (Outcome(ok=False, message="the mount is silent"), "the mount is silent"),
    ],
)
def test_what_is_refused_or_unreadable_cannot_be_gone_to(
    opened: LivePanel, told: FakeWire, answer: Outcome, words: str
) -> None:
    told.outcomes["preview"] = answer
    page(opened, "goto_preview", text="150 -5", number=1)
    until(lambda: opened.goto.get("lines"))
    assert words in "\n".join(opened.goto["lines"])
    assert opened.goto["may_go"] is False


def test_nonsense_is_answered_with_what_may_be_written(opened: LivePanel) -> None:
    page(opened, "goto_preview", text="nowhere at all", number=1)
    until(lambda: "alt 47 az 201" in "\n".join(opened.goto.get("lines", [])))


def test_the_effect_of_a_setting_is_what_the_fold_makes_of_it(opened: LivePanel) -> None:
    from rsoconsole.pipeline import what_if

    page(opened, "try", settings={"filter.q_multiplier": 1e4}, number=3)
    until(lambda: opened.effect.get("rows"))
    live = opened._link.live
    then = what_if(live.records, live.begun_with, {"filter.q_multiplier": 1e4}, 40)
    rows = {row[0]: row[1:] for row in opened.effect["rows"]}
    assert rows["residual rms"][1] == f"{then.residual_rms_arcsec:.2f}″"
    assert rows["NIS mean (2)"][0] != "-"
    for settings, words in (
        ({"filter.q_multiplier": -1}, "q_multiplier"),
        ({"session.root": "/"}, "cannot be tuned here"),
    ):
        page(opened, "try", settings=settings, number=4)
        until(lambda words=words: words in opened.effect.get("fault", ""))


# -- its page --------------------------------------------------------------------------------


def test_a_page_that_is_gone_lets_go_of_the_engine_and_one_that_is_back_takes_it_up(
    opened: LivePanel, told: FakeWire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panel, "UNSEEN_S", 0.05)
    time.sleep(0.2)
    tick = opened.status["tick"]
    time.sleep(0.2)
    assert opened.status["tick"] == tick
    page(opened, "here")
    until(lambda: opened.status["tick"] > tick)


def test_nothing_is_told_before_the_page_has_spoken(told: FakeWire) -> None:
    """ipykernel would have the page's answer wait for the cell that runs."""
    made = LivePanel(wire=told)
    until(lambda: made._unsent.get("status"))
    assert made.status == {}
    page(made, "here")
    assert made.status["reach"] == "attached"
    made.close()


def test_the_page_fetches_nothing_and_sets_words_as_text() -> None:
    script, style = ((STATIC / name).read_text() for name in ("panel.js", "panel.css"))
    for text in (script, style):
        assert "http" not in text
        assert "@import" not in text
        assert "url(" not in text
    assert "import " not in script
    assert "eval(" not in script
    # The kernel's own drawings, in which all words are escaped, and nothing else.
    html = [line.strip() for line in script.splitlines() if "innerHTML" in line]
    assert html == ["place.innerHTML = svg;", "overlay.innerHTML = night.overlay;"]
