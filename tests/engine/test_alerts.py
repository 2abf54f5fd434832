"""Word reaches the operator: what is news, how often, through a bad network, and nothing secret."""

import json
import logging
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families
from typer.testing import CliRunner

from rsoconsole.base import ConfigError
from rsoconsole.cli.app import app
from rsoconsole.cli.telescope._prometheus import metrics_text
from rsoconsole.config import (
    AlertsConfig,
    Config,
    config_faults,
    config_to_toml,
    effective_settings,
    load_config,
    with_setting,
)
from rsoconsole.config.alerts import ALERT_KINDS
from rsoconsole.control import (
    ControlServer,
    Machine,
    Outcome,
    PartHealth,
    Status,
    TrackStatus,
    default_socket_path,
    status_json,
)
from rsoconsole.engine import services_of
from rsoconsole.engine.alerts._news import Alert, SessionAlerts
from rsoconsole.engine.alerts._spool import MOST, OLDEST_NS, QueuedMessage, Spool
from rsoconsole.engine.alerts.child import Limiter
from rsoconsole.engine.alerts.process import AlertProcess, _log_file
from rsoconsole.engine.alerts.services import AlertSender, SendResult, Service, send
from rsoconsole.records import (
    CatalogueMatch,
    Cause,
    Event,
    HiddenBy,
    Identified,
    Miss,
    Missed,
    Record,
    StateChange,
    TrackLost,
)
from rsoconsole.session import SessionReader, SessionWriter
from tests.children.bad_server import BadServer, bad_server, drip
from tests.children.bad_server import send as answer
from tests.children.bad_server import status as refuse
from tests.nights import made_up_night as night
from tests.pages.json_page import expect_documented

PATIENCE_S = 30.0


@pytest.fixture
def server() -> Iterator[BadServer]:
    with bad_server() as running:
        running.default = answer(b"{}")
        yield running


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "state" / "rsoconsole" / "alerts"


def until(is_so: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline, "it never came to be"
        time.sleep(0.02)


def messages(server: BadServer) -> list[dict[str, str]]:
    return [json.loads(body) for body in server.bodies if body]


# What is news


def told(*records: Record) -> list[tuple[str, str]]:
    news = SessionAlerts()
    return [(a.kind, a.text) for each in records for a in news.take(5, each)]


def change(before: str, after: str, **cause: object) -> StateChange:
    reason = Cause(**cause)  # type: ignore[arg-type]
    return StateChange(frame_id=7, before=before, after=after, reason=reason)  # type: ignore[arg-type]


def match(name: str = "INTELSAT 14") -> CatalogueMatch:
    return CatalogueMatch(
        norad_id=36097,
        name=name,
        separation_arcsec=12.3,
        along_track_s=0.1,
        cross_track_arcsec=1.0,
        rate_difference_percent=None,
        tle_age_days=0.5,
        score=1.0,
        probability=0.99,
    )


def identified(verdict: str = "identified", name: str = "INTELSAT 14") -> Identified:
    return Identified(
        frame_id=7,
        track_id=1,
        verdict=verdict,  # type: ignore[arg-type]
        reason="",
        hint="",
        observations=5,
        catalogued=100,
        matches=(match(name),),
    )


LOST = Missed(kind="no detection", lost=TrackLost(kind="coasted", coasted_min=120.0))
CLOUD = Miss(
    frame_id=9,
    reason=Missed(kind="no detection", hidden_by=(HiddenBy(kind="few stars", stars=3),)),
    track_id=1,
)


def test_each_event_of_a_night_is_told_in_a_sentence() -> None:
    found = told(
        change("ACQUIRE", "TRACK", kind="two frames agree"),
        identified(),
        identified(),
        CLOUD,
        CLOUD,
        change("COAST", "LOST", kind="missed", missed=LOST),
        Event(level="alarm", text="limit met: altitude", topic="limit"),
        Event(level="alarm", text="the loop hangs"),
        change("TRACK", "FAULT", kind="instrument", detail="camera is silent"),
        change("TRACK", "IDLE", kind="night ended", detail="the Sun is at -11.9 deg"),
    )
    kinds = [kind for kind, _ in found]
    assert kinds == [
        "lock",
        "identification",
        "clouds",
        "loss",
        "limit",
        "fault",
        "fault",
        "dawn",
    ]
    words = dict(found)
    assert "INTELSAT 14 (36097)" in words["identification"]
    assert "Sun is at -11.9" in words["dawn"]
    assert "camera is silent" in words["fault"]
    assert set(kinds) | {"done"} == set(ALERT_KINDS)


def test_what_the_operator_did_and_what_is_no_news_is_not_told() -> None:
    assert not told(
        change("COAST", "TRACK", kind="measured again"),
        change("TRACK", "SEARCH", kind="looked for again", by="ann"),
        change("TRACK", "IDLE", kind="STOP", by="ann"),
        identified("ambiguous"),
        Event(level="warning", text="slew refused"),
        Miss(frame_id=9, reason=Missed(kind="no detection"), track_id=1),
    )


def test_another_name_for_a_track_is_told_and_done_names_what_was_seen() -> None:
    assert len(told(identified(), identified(name="SES-10"))) == 2
    news = SessionAlerts()
    news.take(1, identified())
    assert "INTELSAT 14 (36097)" in news.closing_alert(2).text


# How often


def alert(kind: str, text: str = "x") -> Alert:
    return Alert(kind=kind, text=text, t_utc_ns=1)  # type: ignore[arg-type]


def test_a_kind_rests_and_what_was_held_back_is_counted() -> None:
    limiter = Limiter(events=ALERT_KINDS, quiet_s=600.0, most_per_hour=20)
    assert limiter.alert_if_allowed(alert("lock"), 0.0) is not None
    assert limiter.alert_if_allowed(alert("lock"), 599.0) is None
    assert limiter.alert_if_allowed(alert("loss"), 599.0) is not None
    later = limiter.alert_if_allowed(alert("lock"), 600.0)
    assert later is not None
    assert "1 more" in later.text


def test_another_fault_is_told_at_once_and_a_flood_of_them_is_bounded() -> None:
    limiter = Limiter(events=ALERT_KINDS, quiet_s=600.0, most_per_hour=5)
    passed = [limiter.alert_if_allowed(alert("fault", f"no {n}"), n) for n in range(100)]
    assert sum(each is not None for each in passed) == 5
    assert limiter.alert_if_allowed(alert("lock"), 100.0) is not None
    assert limiter.alert_if_allowed(alert("fault", "later"), 3700.0) is not None


def test_what_is_not_wanted_is_not_told() -> None:
    limiter = Limiter(events=("fault",), quiet_s=0.0, most_per_hour=5)
    assert limiter.alert_if_allowed(alert("lock"), 0.0) is None


# The spool and the services


def add(spool: Spool, n: int, to: list[str], t_utc_ns: int = 5) -> None:
    spool.add(QueuedMessage(kind="lock", title="t", body=str(n), t_utc_ns=t_utc_ns, pending=to))


def test_the_spool_outlives_its_process_is_bounded_and_holds_no_address(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    for n in range(MOST + 5):
        add(spool, n, ["a", "b"])
    spool.sent(6, "a")
    spool.close()
    again = Spool(tmp_path)
    assert len(again) == MOST
    first_a, first_b = again.oldest_unsent("a"), again.oldest_unsent("b")
    assert first_a is not None
    assert first_b is not None
    assert (first_a.number, first_b.number) == (7, 6)
    add(again, 0, ["a"])
    assert again.oldest_unsent("a") is not None
    again.drop_old(OLDEST_NS + 6, {"a", "b"})
    assert len(again) == 0
    assert stat.S_IMODE((tmp_path / "spool.json").stat().st_mode) == 0o600


@pytest.mark.parametrize("text", ["", "[]", '{"waiting": [{"a": 1}]}', '{"waiting": [3]}', "\x00"])
def test_a_damaged_spool_is_begun_again(tmp_path: Path, text: str) -> None:
    (tmp_path / "spool.json").write_text(text)
    spool = Spool(tmp_path)
    add(spool, 1, ["a"])
    assert len(spool) == 1


def test_a_folder_that_cannot_be_used_keeps_messages_in_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    spool = Spool(tmp_path / "file" / "below")
    assert spool.fault
    add(spool, 1, ["a"])
    assert spool.oldest_unsent("a") is not None
    first = Spool(tmp_path / "one")
    second = Spool(tmp_path / "one")
    assert (first.fault, bool(second.fault)) == (None, True)


def test_what_two_engines_have_to_say_is_in_one_spool_when_the_first_has_ended(
    tmp_path: Path,
) -> None:
    first, second = Spool(tmp_path), Spool(tmp_path, claim_again_s=0.0)
    one = QueuedMessage(kind="lock", title="t", body="first", t_utc_ns=1, pending=["a"])
    first.add(one, ("night 1", 7))
    other = QueuedMessage(kind="lock", title="t", body="second", t_utc_ns=2, pending=["a"])
    second.add(other, ("night 2", 9))
    held = second.oldest_unsent("a")
    assert held is not None
    assert (held.body, bool(second.fault)) == ("second", True)
    first.close()  # as its process's end does, whether it was killed or not
    before = second.oldest_unsent("a")
    assert before is not None
    assert (before.body, second.fault, len(second)) == ("first", None, 2)
    second.sent(held.number, "a")
    second.close()
    third = Spool(tmp_path)
    left = third.oldest_unsent("a")
    assert left is not None
    assert (left.body, len(third)) == ("first", 1)
    assert (third.last_alerted_record("night 1"), third.last_alerted_record("night 2")) == (7, 9)
    third.sent(left.number, "a")
    assert len(third) == 0


def test_a_spool_of_the_first_form_is_read(tmp_path: Path) -> None:
    row = {"number": 3, "kind": "lock", "title": "t", "body": "b", "t_utc_ns": 1, "pending": ["a"]}
    told = {"format": 1, "seen": ["night 1", 7], "waiting": [row]}
    (tmp_path / "spool.json").write_text(json.dumps(told))
    spool = Spool(tmp_path)
    assert (
        len(spool),
        spool.last_alerted_record("night 1"),
        spool.last_alerted_record("night 2"),
    ) == (1, 7, 0)


def test_messages_for_services_of_another_engine_are_not_waited_for(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    add(spool, 1, ["nobody's"], t_utc_ns=time.time_ns())
    sender = AlertSender([], Spool(tmp_path / "own"), send=lambda *_, **__: SendResult(True, ""))
    assert sender.finish(0.0) == 0
    sender = AlertSender([], spool, send=lambda *_, **__: SendResult(True, ""))
    add(spool, 2, ["nobody's"], t_utc_ns=time.time_ns())
    began = time.monotonic()
    assert sender.finish(PATIENCE_S) == 0
    assert time.monotonic() - began < PATIENCE_S / 2


LEAK = """
import io, json, logging, sys, threading
from rsoconsole.engine.alerts import child
child.log_own_messages_only(sys.stderr)
logging.getLogger("urllib3.connectionpool").warning("Retrying: /bot%s/sendMessage", "T0KEN")
logging.getLogger("apprise").error("T0KEN")
logging.getLogger("requests").exception("T0KEN")
logging.getLogger("rsoconsole.engine.alerts.services").warning("tgram 1: no network")
def breaks():
    raise OSError("https://x/T0KEN")
thread = threading.Thread(target=breaks, name="tgram 1")
thread.start()
thread.join()
"""


def test_the_log_of_alerts_has_the_programs_own_words_alone() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LEAK], capture_output=True, text=True, timeout=60, check=True
    )
    assert "T0KEN" not in done.stdout + done.stderr
    assert "tgram 1: no network" in done.stderr
    assert "the thread tgram 1 broke: OSError" in done.stderr


def test_the_log_of_alerts_is_its_owners_alone(state: Path) -> None:
    old = state.parent / "log" / "alerts.log"
    old.parent.mkdir(parents=True)
    old.write_text("before\n")
    old.chmod(0o644)
    with _log_file() as stream:
        stream.write(b"now\n")
    assert stat.S_IMODE(old.stat().st_mode) == 0o600
    assert old.read_text() == "before\nnow\n"
    old.write_bytes(b"x" * 2_000_000)
    with _log_file() as stream:
        stream.write(b"now again\n")
    assert old.stat().st_size < 100


def test_a_service_that_hangs_or_fails_delays_no_other_and_gets_its_message_later(
    tmp_path: Path,
) -> None:
    got: list[tuple[str, str]] = []
    is_up = False

    def send_(url: str, title: str, body: str, *, is_urgent: bool) -> SendResult:
        if url == "x://hangs":
            time.sleep(PATIENCE_S)
        if url == "x://fails" and not is_up:
            return SendResult(False, "offline")
        got.append((url, body))
        return SendResult(True, "sent")

    services = [Service(name, f"x://{name}") for name in ("hangs", "fails", "good")]
    sender = AlertSender(services, Spool(tmp_path), send=send_, first_again_s=0.05)
    began = time.monotonic()
    for n in range(3):
        sender.add(QueuedMessage(kind="lock", title="t", body=str(n), t_utc_ns=time.time_ns()))
    assert time.monotonic() - began < 5.0
    until(lambda: got == [("x://good", "0"), ("x://good", "1"), ("x://good", "2")])
    is_up = True
    until(lambda: [body for url, body in got if url == "x://fails"] == ["0", "1", "2"])
    assert sender.finish(0.0) == 3


def test_apprise_sends_to_a_real_server_and_its_failure_is_a_sentence(server: BadServer) -> None:
    url = server.url.replace("http://", "json://ann:hunter2@")
    assert send(url, "title", "body").ok
    (message,) = messages(server)
    assert (message["title"], message["message"]) == ("title", "body")
    server.default = refuse(500)
    for bad in (url, "json://ann:hunter2@127.0.0.1:9/", "nosuch://hunter2"):
        failed = send(bad, "title", "body")
        assert not failed.ok
        assert "hunter" not in failed.detail


# The process beside the engine


def process(config: AlertsConfig, folder: Path, **settings: object) -> AlertProcess:
    return AlertProcess(
        config,
        folder,
        title="rsoconsole Hill",
        beat_s=0.1,
        look_s=0.1,
        first_again_s=0.1,
        **settings,
    )


def test_a_night_is_told_by_a_process_of_its_own_to_its_end(
    state: Path, tmp_path: Path, server: BadServer
) -> None:
    writer = night.begin(tmp_path / "night")
    url = server.url.replace("http://", "json://")
    alerts = process(AlertsConfig(services=(url,)), writer.folder)
    alerts.start(lambda: True)
    night.armed(writer)
    night.add_frames(writer, range(1, 8))
    until(lambda: messages(server))
    (lock,) = messages(server)
    assert lock["title"] == "rsoconsole Hill: lock"
    writer.append(Event(level="alarm", text="camera is silent", frame_id=7), night.t_of(7))
    assert writer.flush()
    until(lambda: len(messages(server)) == 2)
    assert messages(server)[1]["type"] == "warning"
    writer.close()
    alerts.close()
    until(lambda: len(messages(server)) == 3)
    assert "7 frames, 1 tracks" in messages(server)[2]["message"]
    until(lambda: not _runs(alerts.pid))


def _runs(pid: int | None) -> bool:
    try:
        os.kill(pid or 0, 0)
    except ProcessLookupError:
        return False
    return True


def test_an_engine_that_dies_is_told(state: Path, tmp_path: Path, server: BadServer) -> None:
    writer = night.begin(tmp_path / "night")
    url = server.url.replace("http://", "json://")
    alerts = process(AlertsConfig(services=(url,)), writer.folder, closing_s=0.3)
    alerts.start(lambda: True)
    until(lambda: alerts.pid)
    time.sleep(0.5)
    alerts.close()
    until(lambda: messages(server))
    assert "without closing its session" in messages(server)[0]["message"]
    writer.close()
    until(lambda: not _runs(alerts.pid))


def test_what_could_not_be_sent_is_sent_by_the_next_engine(
    state: Path, tmp_path: Path, server: BadServer
) -> None:
    server.default = refuse(503)
    url = server.url.replace("http://", "json://")
    writer = night.begin(tmp_path / "night")
    alerts = process(AlertsConfig(services=(url,)), writer.folder)
    alerts.start(lambda: True)
    night.armed(writer)
    night.add_frames(writer, range(1, 8))
    until(lambda: messages(server))
    assert alerts.pid is not None
    os.kill(alerts.pid, signal.SIGKILL)  # as a power cut would
    alerts.close()
    writer.close()
    assert json.loads((state / "spool.json").read_text())["waiting"]
    server.bodies.clear()
    server.default = answer(b"{}")
    next_night = night.begin(tmp_path / "next")
    later = process(AlertsConfig(services=(url,)), next_night.folder)
    later.start(lambda: True)
    until(lambda: [m for m in messages(server) if m["title"].endswith(": lock")])
    next_night.close()
    later.close()
    until(lambda: not _runs(later.pid))


def test_a_child_that_dies_is_replaced_and_repeats_no_old_news(
    state: Path, tmp_path: Path, server: BadServer
) -> None:
    url = server.url.replace("http://", "json://")
    writer = night.begin(tmp_path / "night")
    alerts = process(AlertsConfig(services=(url,)), writer.folder, again_s=0.1)
    alerts.start(lambda: True)
    night.armed(writer)
    night.add_frames(writer, range(1, 8))
    until(lambda: len(messages(server)) == 1)
    first = alerts.pid
    assert first is not None
    time.sleep(0.3)
    os.kill(first, signal.SIGKILL)
    until(lambda: alerts.pid != first)
    time.sleep(1.0)
    writer.append(Event(level="alarm", text="camera is silent", frame_id=7), night.t_of(7))
    assert writer.flush()
    until(lambda: len(messages(server)) == 2)
    writer.close()
    alerts.close()
    until(lambda: not _runs(alerts.pid))
    assert [m["title"].rpartition(": ")[2] for m in messages(server)] == ["lock", "fault", "done"]


def test_the_heartbeat_is_called_while_the_loop_lives_and_no_longer(
    state: Path, tmp_path: Path, server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = AlertsConfig(heartbeat_url=f"{server.url}/beat", heartbeat_s=1.0)
    writer = night.begin(tmp_path / "night")
    is_alive = True
    alerts = process(config, writer.folder, alive_s=0.5)
    alerts.start(lambda: is_alive)
    until(lambda: len(server.asked) >= 2)
    is_alive = False
    time.sleep(1.2)
    before = len(server.asked)
    time.sleep(2.2)
    assert len(server.asked) == before
    assert set(server.asked) == {"/beat"}
    writer.close()
    alerts.close()
    until(lambda: not _runs(alerts.pid))


def test_nothing_of_it_takes_the_engines_time_or_ends_it(
    state: Path, tmp_path: Path, server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    began = time.monotonic()
    AlertProcess(AlertsConfig(), tmp_path, title="x").start(lambda: True)
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    writer = night.begin(tmp_path / "night")
    broken = process(AlertsConfig(services=("json://127.0.0.1:9/",)), writer.folder)
    broken.start(lambda: 1 / 0 > 0)
    time.sleep(0.3)
    broken.close()
    unreadable = process(AlertsConfig(services_file=tmp_path / "none"), writer.folder)
    assert "no alerts are sent" in (unreadable.fault or "")
    unreadable.start(lambda: True)
    unreadable.close()
    assert time.monotonic() - began < 5.0
    writer.close()


def test_an_address_is_on_no_command_line_in_no_session_and_in_no_output(
    state: Path, tmp_path: Path, server: BadServer
) -> None:
    secret = "json://ann:hunter2@127.0.0.1:9/hunter3"
    beat = "https://hunter4@example.org/hunter5?hunter6"
    path = tmp_path / "config.toml"
    path.write_text(f'[alerts]\nservices = ["{secret}"]\nheartbeat_url = "{beat}"\n')
    config = load_config(path)
    assert config.alerts.services == (secret,)
    changed = with_setting(config, "detector.tau", 0.2)
    assert changed.alerts.services == (secret,)
    writer = SessionWriter.create(tmp_path / "night", config, {"title": "x"})
    alerts = process(config.alerts.model_copy(update={"heartbeat_url": ""}), writer.folder)
    alerts.start(lambda: True)
    until(lambda: alerts.pid)
    command = subprocess.run(
        ["ps", "-o", "args=", "-p", str(alerts.pid)], capture_output=True, text=True, check=True
    ).stdout
    writer.append(Event(level="alarm", text="camera is silent", frame_id=7), night.t_of(7))
    writer.close()
    alerts.close()
    until((state / "spool.json").exists)
    assert alerts.pid is not None
    os.kill(alerts.pid, signal.SIGKILL)
    shown = [command, config_to_toml(config), repr(config), (state / "spool.json").read_text()]
    shown += [str(each.value) for each in effective_settings(path)]
    shown += [str(SessionReader(writer.folder).read_meta())]
    shown += [(state.parent / "log" / "alerts.log").read_text()]
    assert "hunter" not in " ".join(shown)
    assert SessionReader(writer.folder).config().alerts.services == ("json://...",)
    for bad in (f'services = "{secret}"', 'services = ["hunter2"]', 'heartbeat_url = "hunter2"'):
        path.write_text(f"[alerts]\n{bad}\n")
        assert config_faults(path)
        assert "hunter" not in repr(config_faults(path))
        with pytest.raises(ConfigError) as refused:
            load_config(path)
        assert "hunter" not in str(refused.value)


def test_addresses_in_a_file_are_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "alerts.txt"
    path.write_text("# mine\nntfy://topic\n\njson://x\n")
    path.chmod(0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        services_of(AlertsConfig(services_file=path))
    path.chmod(0o600)
    services = services_of(AlertsConfig(services=("ntfy://topic",), services_file=path))
    assert [each.name for each in services] == ["ntfy 1", "json 2"]
    path.write_text("hunter2\n")
    with pytest.raises(ConfigError, match="address 1") as refused:
        services_of(AlertsConfig(services_file=path))
    assert "hunter2" not in str(refused.value)


def test_apprise_is_not_loaded_by_the_program_nor_by_a_child_with_nothing_to_send() -> None:
    code = (
        "import sys, rsoconsole.cli.app, rsoconsole.engine.service.service;"
        "import rsoconsole.engine.alerts.child;"
        "sys.exit('apprise' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# The verbs


def test_alerts_test_tries_each_service_and_says_what_came_of_it(
    tmp_path: Path, server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "config.toml"
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(path))
    done = CliRunner().invoke(app, ["alerts", "test"])
    assert isinstance(done.exception, ConfigError)
    good = server.url.replace("http://", "json://")
    path.write_text(f'[alerts]\nservices = ["{good}"]\nheartbeat_url = "{server.url}/beat"\n')
    done = CliRunner().invoke(app, ["alerts", "test", "--json"])
    assert done.exit_code == 0, done.output
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    for row in rows:
        expect_documented("alerts test", row)
    assert [(row["service"], row["ok"]) for row in rows] == [("json 1", True), ("heartbeat", True)]
    path.write_text(f'[alerts]\nservices = ["json://127.0.0.1:9/", "{good}"]\n')
    done = CliRunner().invoke(app, ["alerts", "test", "--json"])
    assert done.exit_code == 1
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["ok"] for row in rows] == [False, True]


def test_alerts_test_logs_nothing_that_a_library_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def send_(url: str, title: str, body: str) -> SendResult:
        logging.getLogger("urllib3.connectionpool").warning("Retrying: %s", url)
        logging.getLogger("rsoconsole.engine.alerts.services").warning("own words")
        return SendResult(True, "sent")

    monkeypatch.setattr("rsoconsole.engine.alerts.services.send", send_)
    path = tmp_path / "config.toml"
    path.write_text('[alerts]\nservices = ["tgram://T0KEN/1"]\n')
    done = CliRunner().invoke(app, ["alerts", "test", "--config", str(path)])
    assert done.exit_code == 0, done.output
    assert "own words" in caplog.text
    assert "T0KEN" not in caplog.text


def test_a_service_that_never_answers_is_given_up(
    server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rsoconsole.engine import send_heartbeat, send_within

    monkeypatch.setattr(
        "rsoconsole.engine.alerts.services.send", lambda *_: time.sleep(5.0) or SendResult(True, "")
    )
    assert "no answer" in send_within("json://x", "t", "b", limit_s=0.2).detail
    server.default = drip(3.0)
    assert not send_heartbeat(f"{server.url}/beat", limit_s=0.3).ok


def figures(text: str) -> dict[tuple[str, ...], float]:
    """As Prometheus' own parser reads them."""
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_prometheus_reads_the_status() -> None:
    told_ = Status(
        state="TRACK",
        frame_id=24,
        alt_deg=38.1,
        is_slewing=False,
        health=(PartHealth(name='a "part"\\', ok=True, text="x"),),
        machine=Machine(cpu_temperature_c=51.5),
        tracks=(
            TrackStatus(track_id=2, nis=1.5, mag=12.41, band="V"),
            TrackStatus(track_id=3, mag=-9.3, band="instrumental"),
        ),
        limiting_mag=14.2,
        now_utc_ns=1_700_000_000_123_456_789,
    )
    found = figures(metrics_text(told_))
    assert found["rsoconsole_up",] == 1.0
    assert found["rsoconsole_state", "TRACK"] == 1.0
    assert found["rsoconsole_state", "FAULT"] == 0.0
    assert found["rsoconsole_health_ok", 'a "part"\\'] == 1.0
    assert found["rsoconsole_track_nis", "2"] == 1.5
    assert found["rsoconsole_limiting_magnitude",] == 14.2
    assert found["rsoconsole_track_magnitude", "2"] == 12.41
    assert ("rsoconsole_track_magnitude", "3") not in found
    assert ("rsoconsole_zero_point_magnitude",) not in found
    assert found["rsoconsole_clock_seconds",] == pytest.approx(1_700_000_000.1234567)
    assert ("rsoconsole_parked",) not in found
    assert figures(metrics_text(None)) == {("rsoconsole_up",): 0.0}


def test_the_text_file_is_written_whole_with_and_without_an_engine(
    state: Path, tmp_path: Path
) -> None:
    out = tmp_path / "rsoconsole.prom"
    words = ["status", "--prometheus", "--out", str(out)]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert figures(out.read_text()) == {("rsoconsole_up",): 0.0}
    data = status_json(Status(state="SEARCH"))
    with ControlServer(default_socket_path(), lambda _request: Outcome(ok=True, data=data)):
        assert CliRunner().invoke(app, words).exit_code == 0
        printed = CliRunner().invoke(app, words[:2]).stdout
    assert figures(out.read_text())["rsoconsole_state", "SEARCH"] == 1.0
    assert printed == out.read_text()
    assert list(tmp_path.glob("*.part")) == []


def test_a_default_night_alerts_nobody() -> None:
    assert not Config().alerts.is_configured
