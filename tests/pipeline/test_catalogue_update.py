"""Elements are fetched when asked, at most once in two hours, and a bad server costs nothing."""

import contextlib
import gzip
import io
import json
import os
import stat
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sgp4 import exporter
from typer.testing import CliRunner

from rsoconsole.base import ConfigError, OrbitError
from rsoconsole.cli.app import app
from rsoconsole.config import (
    config_faults,
    config_to_toml,
    effective_settings,
    load_config,
    without_secrets,
    write_initial_config,
    write_settings,
)
from rsoconsole.control import ControlServer, Outcome, Status, default_socket_path, status_json
from rsoconsole.orbits import parse_element_sets
from rsoconsole.pipeline import (
    ElementStore,
    SourceUpdate,
    SourceUpdater,
    default_folder,
    parse_source,
    read_catalogue,
)
from rsoconsole.pipeline.sources import fetch as fetching
from tests.children.bad_server import (
    BadServer,
    Behaviour,
    bad_server,
    cut_off,
    drip,
    endless,
    send,
    send_gzip,
    status,
)
from tests.pages.json_page import expect_documented

INTELSAT = """INTELSAT 14 (IS-14)
1 36097U 09064A   23172.91666667 -.00000250  00000+0  00000+0 0  9992
2 36097   0.0180 286.4021 0002417 279.9370 184.4700  1.00270000 49849
"""
HOUR_NS = 3600 * 10**9
GP = "/NORAD/elements/gp.php"


def omm(name: str, number: int, epoch: str = "2023-06-21T22:00:00.000000") -> dict[str, object]:
    """One object as CelesTrak's JSON has it."""
    return {
        "OBJECT_NAME": name,
        "OBJECT_ID": "2009-064A",
        "EPOCH": epoch,
        "MEAN_MOTION": 1.0027,
        "ECCENTRICITY": 0.00024,
        "INCLINATION": 0.018,
        "RA_OF_ASC_NODE": 286.4,
        "ARG_OF_PERICENTER": 279.9,
        "MEAN_ANOMALY": 184.5,
        "EPHEMERIS_TYPE": 0,
        "CLASSIFICATION_TYPE": "U",
        "NORAD_CAT_ID": number,
        "ELEMENT_SET_NO": 999,
        "REV_AT_EPOCH": 4984,
        "BSTAR": 0,
        "MEAN_MOTION_DOT": -2.5e-06,
        "MEAN_MOTION_DDOT": 0,
    }


GOOD = json.dumps([omm("INTELSAT 14 (IS-14)", 36097), omm("NEW ONE", 412_345)]).encode()


@pytest.fixture
def server() -> Iterator[BadServer]:
    with bad_server() as running:
        yield running


class Night:
    """A cache with a clock of its own."""

    def __init__(self, folder: Path, server: BadServer) -> None:
        self.store, self.server = ElementStore(folder), server
        self.now_utc_ns = 1_800_000_000 * 10**9

    def update(self, *texts: str, deadline_s: float = 20.0) -> list[SourceUpdate]:
        run = self.run(deadline_s=deadline_s)
        return list(run.run([parse_source(text) for text in texts]))

    def run(
        self, wait: Callable[[], None] = lambda: None, deadline_s: float = 20.0
    ) -> SourceUpdater:
        return SourceUpdater(
            store=self.store,
            celestrak_url=self.server.url,
            space_track_url=self.server.url,
            space_track_login=self.store.folder / "login",
            deadline_s=deadline_s,
            wait=wait,
            now_utc_ns=lambda: self.now_utc_ns,
        )

    def one(self, behaviour: Behaviour, text: str = "celestrak:geo", **how: float) -> SourceUpdate:
        self.server.default = behaviour
        (updated,) = self.update(text, **how)
        return updated


@pytest.fixture
def night(tmp_path: Path, server: BadServer) -> Night:
    return Night(tmp_path / "cache", server)


def test_what_celestrak_sends_is_kept_and_read_with_numbers_of_six_digits(night: Night) -> None:
    updated = night.one(send_gzip(GOOD))
    assert updated.is_fetched
    assert updated.kept.objects == 2
    assert night.server.asked == [f"{GP}?GROUP=geo&FORMAT=json"]
    assert {each.norad_id for each in read_catalogue([night.store.folder]).entries} == {
        36097,
        412_345,
    }


def test_each_source_is_asked_where_it_lies(night: Night) -> None:
    night.server.default = send(GOOD)
    night.update("supgp:intelsat", "celestrak:CATNR=25544")
    assert night.server.asked == [
        "/NORAD/elements/supplemental/sup-gp.php?FILE=intelsat&FORMAT=json",
        f"{GP}?CATNR=25544&FORMAT=json",
    ]


def test_a_source_is_asked_at_most_once_in_two_hours_whatever_came_of_it(night: Night) -> None:
    for behaviour in (send(GOOD), status(500), cut_off(GOOD[:200], len(GOOD))):
        night.now_utc_ns += 3 * HOUR_NS
        night.one(behaviour)
        before = len(night.server.asked)
        night.now_utc_ns += 2 * HOUR_NS - 1
        again = night.one(send(GOOD))
        assert len(night.server.asked) == before
        assert not again.is_fetched
        assert not again.is_fault
        assert "once in two hours" in again.words
    night.now_utc_ns += 1
    assert night.one(send(GOOD)).is_fetched


def test_a_clock_that_was_in_the_future_blocks_no_source_for_years(night: Night) -> None:
    night.now_utc_ns += 10_000 * HOUR_NS
    night.one(send(GOOD))
    night.now_utc_ns -= 10_000 * HOUR_NS
    kept = night.store.statuses()["celestrak:geo"]
    assert kept.due_utc_ns(night.now_utc_ns) == night.now_utc_ns + 2 * HOUR_NS


def test_a_stamp_of_the_future_counts_as_asked_now_and_only_once(night: Night) -> None:
    night.now_utc_ns += 10_000 * HOUR_NS
    night.one(send(GOOD))
    night.now_utc_ns -= 10_000 * HOUR_NS
    assert not night.one(send(GOOD)).is_fetched
    night.now_utc_ns += 2 * HOUR_NS
    assert night.one(send(GOOD)).is_fetched


def test_of_two_updates_that_wait_for_the_mount_one_asks(night: Night) -> None:
    night.server.default = send(GOOD)
    words: list[str] = []

    def wait() -> None:
        if not words:
            words.append("the other")
            night.update("celestrak:geo")

    (updated,) = night.run(wait).run([parse_source("celestrak:geo")])
    assert not updated.is_fetched
    assert "once in two hours" in updated.words
    assert len(night.server.asked) == 1


def test_what_was_fetched_is_kept_though_the_mount_slews_on(night: Night) -> None:
    night.server.default = send(GOOD)

    def wait() -> None:
        if night.server.asked:
            raise OrbitError("the mount slews")

    (updated,) = night.run(wait).run([parse_source("celestrak:geo")])
    assert updated.is_fetched
    assert updated.kept.objects == 2


def test_a_gzip_of_several_members_is_read_to_its_end(night: Night) -> None:
    text = json.dumps([omm(f"NO {n}", n) for n in range(40_000, 40_400)]).encode()
    packed = gzip.compress(text[:900]) + gzip.compress(text[900:])
    assert night.one(send(packed, Content_Encoding="gzip")).kept.objects == 400
    assert night.one(send(packed), "supgp:intelsat").kept.objects == 400


@pytest.mark.parametrize("code", [401, 403, 429, 451])
def test_a_refusal_is_never_asked_again_nor_is_its_host_until_it_is_added_again(
    night: Night, code: int
) -> None:
    night.server.default = status(code)
    first, second = night.update("celestrak:geo", "supgp:intelsat")
    assert first.is_fault
    assert "refuses" in first.words
    assert "just refused" in second.words
    assert len(night.server.asked) == 1
    night.now_utc_ns += 1000 * HOUR_NS
    (later,) = night.update("celestrak:geo")
    assert len(night.server.asked) == 1
    assert "catalogue add" in later.words
    night.store.update_status(parse_source("celestrak:geo"), refused_utc_ns=None)
    assert night.one(send(GOOD)).is_fetched


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"\n GP data has not updated since\nnothing else", "(403): GP data has not updated since"),
        (b"<html><title>Too many\n requests</title>pw", "(403): Too many requests"),
        (b"<html>pw", "(403)"),
        (b"", "(403)"),
        (
            b"no key hunter%2B3 or hunter+3 of ann, hunter2\x1b[2J",
            "(403): no key ... or ... of ...",
        ),
        (b"x" * 100_000, "(403): xxx"),
    ],
)
@pytest.mark.parametrize("is_packed", [False, True])
def test_why_a_server_refuses_is_said_in_its_words_but_for_secrets(
    night: Night, body: bytes, words: str, is_packed: bool
) -> None:
    url = night.server.url.replace("http://", "http://ann:hunter2@") + "/x?key=hunter%2B3"
    behaviour = (
        status(403, gzip.compress(body), Content_Encoding="gzip")
        if is_packed
        else status(403, body)
    )
    found = night.one(behaviour, f"url:{url}")
    assert f"refuses {words}" in found.words
    assert "hunter" not in found.words
    assert "pw" not in found.words
    assert found.words.isprintable()
    assert len(found.words) < 400


BAD: dict[str, tuple[Behaviour, str]] = {
    "fault": (status(500), "fault 500"),
    "not there": (status(404), "is its name right"),
    "a page": (send(b"<!DOCTYPE html><html>sign in</html>", "text/html"), "web page"),
    "a remark": (send(b"Invalid query: GROUP=goe", "text/plain"), "Invalid query"),
    "nothing": (send(b""), "empty"),
    "an empty list": (send(b"[]"), "no element set"),
    "cut off": (cut_off(GOOD[:300], len(GOOD)), "before it was whole"),
    "cut off without a length": (endless(GOOD[:300], 300), "no OMM in JSON"),
    "gzip cut off": (
        send(gzip.compress(GOOD)[:-20], Content_Encoding="gzip"),
        "before it was whole",
    ),
    "no gzip": (send(GOOD, Content_Encoding="gzip"), "before it was whole"),
    "a circle": (status(302, Location="/NORAD/elements/gp.php"), "circles"),
    "another kind of address": (status(302, Location="file:///etc/passwd"), ""),
    "bytes": (send(bytes(range(256)) * 40), "no text"),
    "a field missing": (send(json.dumps([{"NORAD_CAT_ID": 5}]).encode()), "EPOCH is missing"),
    "deep": (send(b"[" * 100_000), "nested"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_server_that_misbehaves_is_one_sentence_and_what_was_kept_stays(
    night: Night, name: str
) -> None:
    night.one(send(GOOD))
    night.now_utc_ns += 3 * HOUR_NS
    behaviour, words = BAD[name]
    updated = night.one(behaviour)
    assert updated.is_fault
    assert words in updated.words
    assert "is kept" in updated.words
    assert "\n" not in updated.words
    assert updated.kept.fault is not None
    assert len(read_catalogue([night.store.folder]).entries) == 2


def test_of_what_comes_a_bad_set_costs_itself_alone_and_is_named(night: Night) -> None:
    three = [omm("ONE", 1), omm("TWO", 2, epoch="soon"), omm("THREE", 3)]
    updated = night.one(send(json.dumps(three).encode()))
    assert updated.is_fetched
    assert "2 objects, 1 of 3 element sets is not used" in updated.words
    assert "object 2: 'soon' is not a time" in updated.words
    (bad,) = night.store.statuses()["celestrak:geo"].not_used
    assert (bad.norad_id, bad.name, bad.place) == (2, "TWO", "object 2")
    read = read_catalogue([night.store.folder])
    assert ([each.norad_id for each in read.entries], len(read.not_used)) == ([1, 3], 1)


def test_of_an_answer_that_ends_too_early_the_whole_objects_are_kept(night: Night) -> None:
    updated = night.one(endless(GOOD[:-40], len(GOOD) - 40))
    assert updated.kept.objects == 1
    assert "1 of 2 element sets is not used" in updated.words


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"GP data has not updated since\nyour last successful download", "not updated since your"),
        (b'[{"error":"You have violated your query rate limit"}]', "but: You have violated"),
        (b"<html><title>Busy</title></html>", "but: Busy"),
        (b"no such key hunter22 here", "no such key ... here"),
    ],
)
def test_what_a_server_says_is_quoted_without_what_the_address_keeps_secret(
    night: Night, body: bytes, words: str
) -> None:
    night.server.default = send(body)
    (updated,) = night.update(f"url:{night.server.url}/x?key=hunter22")
    assert updated.is_fault
    assert words in updated.words
    assert "hunter" not in updated.words


def test_a_server_that_drips_is_left_at_the_deadline(night: Night) -> None:
    updated = night.one(drip(8.0), deadline_s=0.5)
    assert updated.is_fault
    assert "longer than" in updated.words


def test_a_body_without_end_and_a_bomb_are_left_where_they_grow_too_large(
    night: Night, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fetching, "MAX_BYTES", 1 << 20)
    assert "sends more than 1 MB" in night.one(endless(b" " * 65536, 4 << 20)).words
    night.now_utc_ns += 3 * HOUR_NS
    assert "sends more than 1 MB" in night.one(send_gzip(b" " * (50 << 20))).words


def test_without_a_network_nothing_counts_as_asked(night: Night) -> None:
    night.server.url = "http://127.0.0.1:9"
    (updated,) = night.update("celestrak:geo")
    assert updated.is_fault
    assert "network" in updated.words
    assert night.store.statuses()["celestrak:geo"].asked_utc_ns is None


def test_amateurs_archives_and_lines_are_read(night: Night) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("classfd.tle", INTELSAT)
    for behaviour in (send(packed.getvalue()), send(gzip.compress(INTELSAT.encode()))):
        assert night.one(behaviour, f"url:{night.server.url}/classfd").kept.objects == 1
        night.now_utc_ns += 3 * HOUR_NS


def test_space_track_is_asked_under_an_account_that_stays_secret(night: Night) -> None:
    night.store.folder.mkdir()
    login = night.store.folder / "login"
    login.write_text("ann@example.org\nvery secret\n")
    login.chmod(0o644)
    night.server.default = send(GOOD)
    (open_,) = night.update("space-track:geo")
    assert "chmod 600" in open_.words
    assert night.server.asked == []
    login.chmod(0o600)
    night.now_utc_ns += 3 * HOUR_NS
    night.server.behaviours["/ajaxauth/login"] = send(b'""')
    (updated,) = night.update("space-track:geo")
    assert updated.is_fetched
    assert night.server.asked[0] == "/ajaxauth/login"
    assert night.server.bodies[0] == b"identity=ann%40example.org&password=very+secret"
    assert "/class/gp/" in night.server.asked[1]
    night.now_utc_ns += 3 * HOUR_NS
    night.server.behaviours["/ajaxauth/login"] = send(b'{"Login":"Failed"}')
    (failed,) = night.update("space-track:geo")
    assert failed.kept.refused_utc_ns is not None
    told = (night.store.folder / "sources.json").read_text() + failed.words
    assert "secret" not in told


def test_an_account_is_shown_to_one_host_only(night: Night) -> None:
    night.store.folder.mkdir()
    login = night.store.folder / "login"
    login.write_text("ann\nsecret\n")
    login.chmod(0o600)
    with bad_server() as other:
        night.server.default = status(307, Location=f"{other.url}/steal")
        (updated,) = night.update("space-track:all")
        assert updated.is_fault
        assert other.asked == []


def test_a_password_in_an_address_goes_to_its_own_host_alone(night: Night) -> None:
    url = night.server.url.replace("http://", "http://ann:hunter2@")
    assert night.one(send(GOOD), f"url:{url}/a").is_fetched
    assert night.server.logins == ["Basic YW5uOmh1bnRlcjI="]
    night.now_utc_ns += 3 * HOUR_NS
    with bad_server() as other:
        other.default = send(GOOD)
        assert night.one(status(302, Location=f"{other.url}/b"), f"url:{url}/a").is_fetched
        assert other.logins == [None]


def test_the_first_source_has_precedence_until_a_later_one_is_three_days_newer(
    night: Night,
) -> None:
    def sent(day: int, motion: float) -> Behaviour:
        one = omm("INTELSAT 14", 36097, f"2023-06-{day:02d}T00:00:00")
        return send(json.dumps([{**one, "MEAN_MOTION": motion}]).encode())

    night.server.behaviours = {
        "/NORAD/elements/supplemental/sup-gp.php": sent(20, 1.001),
        GP: sent(22, 1.002),
    }
    order = [parse_source("supgp:intelsat"), parse_source("celestrak:geo")]
    night.store.set_sources(order)
    night.update("supgp:intelsat", "celestrak:geo")
    (entry,) = read_catalogue([night.store.folder]).entries
    assert entry.revolutions_a_day == pytest.approx(1.001)
    night.server.behaviours[GP] = sent(25, 1.002)
    night.now_utc_ns += 3 * HOUR_NS
    night.update("celestrak:geo")
    (entry,) = read_catalogue([night.store.folder]).entries
    assert entry.revolutions_a_day == pytest.approx(1.002)


def test_a_damaged_index_loses_no_elements_and_is_written_again(night: Night) -> None:
    night.one(send(GOOD))
    (night.store.folder / "sources.json").write_text('{"sources": [{"source": 3}]}')
    assert len(read_catalogue([night.store.folder]).entries) == 2
    night.store.set_sources([parse_source("celestrak:geo")])
    night.now_utc_ns += 3 * HOUR_NS
    assert night.one(send(GOOD)).is_fetched


@pytest.mark.parametrize("damage", ["lost", "damaged"])
def test_after_a_damaged_or_lost_index_an_update_keeps_every_file(
    night: Night, damage: str
) -> None:
    night.server.default = send(GOOD)
    night.update("celestrak:geo", "supgp:intelsat")
    index = night.store.folder / "sources.json"
    if damage == "lost":
        index.unlink()
    else:
        index.write_text(index.read_text()[:100])
    files = {path: path.read_bytes() for path in night.store.folder.glob("*.txt")}
    night.store.set_sources([parse_source(each) for each in ("supgp:intelsat", "celestrak:geo")])
    assert {path: path.read_bytes() for path in night.store.folder.glob("*.txt")} == files
    assert set(night.store.files()) == set(files)
    assert len(files) == 2
    for kept in night.store.statuses().values():
        assert kept.objects == 2
        assert kept.asked_utc_ns is not None


def test_a_file_of_a_recovered_index_is_one_row_when_it_is_fetched_again(night: Night) -> None:
    night.one(send(GOOD))
    (night.store.folder / "sources.json").unlink()
    night.one(send(GOOD))
    assert len(night.store.files()) == 1


def test_an_index_that_somebody_wrote_leads_to_no_file_outside_the_cache(night: Night) -> None:
    night.one(send(GOOD))
    index = night.store.folder / "sources.json"
    index.write_text(index.read_text().replace(parse_source("celestrak:geo").slug, "../../x"))
    assert all(path.parent == night.store.folder for path in night.store.files())


def test_the_cache_is_its_owners_alone(night: Night) -> None:
    night.one(send(GOOD))
    for path in night.store.folder.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600, path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("celestrak:", "no source"),
        ("geo", "no source"),
        ("celestrak:../x", "no group"),
        ("celestrak:a b&c", "no group"),
        ("url:ftp://x", "no address"),
        ("url:https://", "no address"),
        ("file:here", "from the root"),
        ("space-track:a b", "no query"),
    ],
)
def test_a_source_that_is_none_says_how_one_is_written(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_source(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("url:https://ann:pw@x.org:8000/a?key=1", "url:https://x.org:8000/a?..."),
        ("https://ann:pw@x.org/a#pw", "https://x.org/a"),
        ("url:https://ann:pw@x.org:bad/", "url:https://..."),
        ("url:https://ann:p/w@x.org/", "url:https://..."),
        ("url:https://ann:1/pw@x.org/", "url:https://..."),
        ("url:https:ann:pw@x.org/", "url:https://..."),
        ("url:ann:pw@x.org/", "url:..."),
        ("url:https://[ann:pw@x.org", "url:https://..."),
        ("url:https://x.org/ ?key=pw", "url:https://..."),
        ("ann:pw@x.org", "..."),
        ("x.org/a?key=pw", "..."),
        ("celestrak:https://ann:pw@x.org", "celestrak:..."),
        ("celestrak:ann:pw@x.org", "celestrak:..."),
        ("space-track:key?pw", "space-track:..."),
        ("file://ann:pw@x.org/a", "file:..."),
        ("file:/home/a@b/c?.tle", "file:/home/a@b/c?.tle"),
        ("celestrak:geo", "celestrak:geo"),
        ("url:https://[2001:db8::1]/a", "url:https://[2001:db8::1]/a"),
    ],
)
def test_what_an_address_carries_is_not_shown(text: str, words: str) -> None:
    assert without_secrets(text) == words
    with contextlib.suppress(ValueError):
        parse_source(text)
        return
    with pytest.raises(ValueError, match=r".*") as found:
        parse_source(text)
    assert "pw" not in str(found.value)


# The verbs


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, server: BadServer) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    path = tmp_path / "config.toml"
    path.write_text(f'[catalogue]\ncelestrak_url = "{server.url}"\n')
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(path))
    return path


def verb(*words: str, code: int = 0) -> list[dict[str, object]]:
    done = CliRunner().invoke(app, ["catalogue", *words, "--json"])
    assert done.exit_code == code, (done.output, done.exception)
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_a_file_that_is_added_is_used_without_any_network(
    home: Path, tmp_path: Path, server: BadServer
) -> None:
    elements = tmp_path / "usb.tle"
    elements.write_text(INTELSAT)
    (row,) = verb("add", str(elements))
    expect_documented("catalogue list", row)
    assert row["objects"] == 1
    assert row["in_use"] is True
    assert load_config().catalogue.tle_files == (default_folder(),)
    elements.unlink()
    assert [
        each.norad_id for each in read_catalogue(load_config().catalogue.tle_files).entries
    ] == [36097]
    (row,) = verb("list")
    assert row["objects"] == 1
    assert server.asked == []


def test_a_file_with_a_bad_set_is_added_and_it_is_named(home: Path, tmp_path: Path) -> None:
    elements = tmp_path / "two.tle"
    elements.write_text(INTELSAT + INTELSAT.replace("36097", "36098"))
    for row in verb("add", str(elements)) + verb("list"):
        expect_documented("catalogue list", row)
        assert row["objects"] == 1
        (bad,) = row["not_used"]  # type: ignore[misc]
        assert bad["norad_id"] == 36098
        assert "checksum" in bad["words"]
    done = CliRunner().invoke(app, ["catalogue", "list"])
    assert "1 of 2 element sets is not used" in done.stdout


def test_sources_are_added_updated_and_listed(home: Path, server: BadServer) -> None:
    server.default = send(GOOD)
    assert [row["objects"] for row in verb("add", "celestrak:geo", "celestrak:visual")] == [0, 0]
    assert server.asked == []
    for row in verb("update"):
        expect_documented("catalogue update", row)
        assert row["fetched"] is True
    assert [row["source"] for row in verb("list")] == ["celestrak:geo", "celestrak:visual"]
    verb("add", "--first", "supgp:ses")
    assert load_config().catalogue.sources[0] == "supgp:ses"
    server.default = status(403)
    refused = verb("update", code=1)
    assert [row["ok"] for row in refused] == [False, True, True]
    asked = len(server.asked)
    verb("update")
    assert len(server.asked) == asked
    server.default = send(GOOD)
    verb("add", "supgp:ses")
    # added again it may be asked, but not within the two hours
    assert verb("update")[0]["fetched"] is False
    assert len(server.asked) == asked


def test_nothing_is_fetched_unasked_and_without_sources_it_says_what_to_do(
    home: Path, server: BadServer
) -> None:
    done = CliRunner().invoke(app, ["catalogue", "update"])
    assert isinstance(done.exception, OrbitError)
    assert "catalogue add" in str(done.exception)
    done = CliRunner().invoke(app, ["catalogue", "update", "celestrak:geo"])
    assert isinstance(done.exception, OrbitError)
    assert server.asked == []
    assert load_config().catalogue.sources == ()


def test_a_file_that_cannot_be_read_is_not_added(home: Path, tmp_path: Path) -> None:
    before = home.read_text()
    bad = tmp_path / "bad.tle"
    bad.write_text(INTELSAT.replace("00000+0 0  999", "00000+0 0  998"))
    for path in (bad, tmp_path / "none.tle", tmp_path):
        done = CliRunner().invoke(app, ["catalogue", "add", f"file:{path}"])
        assert isinstance(done.exception, OrbitError)
        assert str(path) in str(done.exception)
    assert home.read_text() == before


def test_a_source_taken_from_the_configuration_leaves_the_cache(
    home: Path, server: BadServer
) -> None:
    server.default = send(GOOD)
    verb("add", "celestrak:geo", "celestrak:visual")
    verb("update")
    home.write_text(home.read_text().replace(', "celestrak:visual"', ""))
    verb("update")
    assert len(ElementStore().files()) == 1


def test_a_password_of_a_mirror_is_in_no_output_and_no_session(
    home: Path, server: BadServer, tmp_path: Path
) -> None:
    secret = server.url.replace("http://", "http://ann:hunter2@")
    home.write_text(f'[catalogue]\ncelestrak_url = "{secret}"\nspace_track_url = "{secret}"\n')
    config = load_config()
    assert config.catalogue.celestrak_url == secret
    values = {each.name: each.value for each in effective_settings()}
    assert values["catalogue.celestrak_url"] == server.url
    assert values["catalogue.space_track_url"] == server.url
    for told in (repr(config), str(config.model_dump(mode="json")), config_to_toml(config)):
        assert "hunter" not in told
    for name in ("celestrak_url", "space_track_url"):
        home.write_text(f'[catalogue]\n{name} = "ftp://ann:hunter2@x.org"\n')
        assert "hunter" not in repr(config_faults())
        with pytest.raises(ConfigError) as found:
            load_config()
        assert "hunter" not in str(found.value)


def test_a_home_of_nobody_is_one_clear_line(home: Path) -> None:
    before = home.read_text()
    for text in ("~nosuch/x", "file:~nosuch/x"):
        done = CliRunner().invoke(app, ["catalogue", "add", text])
        assert isinstance(done.exception, OrbitError)
        assert "there is no such user" in str(done.exception)
    assert home.read_text() == before
    home.write_text('[session]\nroot = "~nosuch/x"\n')
    with pytest.raises(ConfigError, match="there is no such user"):
        load_config()


def test_a_configuration_that_may_hold_a_password_is_its_owners_from_its_first_byte(
    home: Path, server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    home.chmod(0o644)
    modes = []
    replace = Path.replace

    def watched(self: Path, target: Path) -> Path:
        modes.append(stat.S_IMODE(self.stat().st_mode))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", watched)
    monkeypatch.setattr(Path, "chmod", lambda *_: pytest.fail("too late"))
    verb("add", "url:" + server.url.replace("http://", "http://ann:hunter2@"))
    home.unlink()
    write_initial_config()
    write_settings(home, {"catalogue.gate_deg": 0.3})
    home.unlink()
    write_settings(home, {"catalogue.gate_deg": 0.3})
    assert modes
    assert {stat.S_IMODE(home.stat().st_mode), *modes} == {0o600}


def test_a_password_in_an_address_is_in_no_output_and_the_file_is_its_owners(
    home: Path, server: BadServer
) -> None:
    secret = server.url.replace("http://", "http://ann:hunter2@") + "/x?key=hunter3"
    server.default = status(500)
    rows = verb("add", secret) + verb("update", code=1) + verb("list")
    assert "fault 500" in str(rows[1]["detail"])
    rows += [{"value": each.value} for each in effective_settings()]
    assert "hunter" not in json.dumps(rows, default=str)
    assert "hunter" not in repr(load_config().model_dump(mode="json"))
    assert load_config().catalogue.sources == (f"url:{secret}",)
    assert stat.S_IMODE(home.stat().st_mode) == 0o600
    home.write_text(f'[catalogue]\nsources = "url:{secret}"\n')
    assert "hunter" not in repr(config_faults())


def test_while_the_mount_slews_the_update_waits(
    home: Path, server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rsoconsole.cli.recorded.catalogue._POLL_S", 0.02)
    server.default = send(GOOD)
    verb("add", "celestrak:geo")
    looks: list[int] = []

    def handle(_request: object) -> Outcome:
        looks.append(len(server.asked))
        return Outcome(ok=True, data=status_json(Status(is_slewing=len(looks) < 4)))

    with ControlServer(default_socket_path(), handle):
        assert verb("update")[0]["fetched"] is True
    assert looks[:4] == [0, 0, 0, 0]
    assert len(server.asked) == 1


def test_a_mount_that_slews_on_and_on_has_the_update_give_up(
    home: Path, server: BadServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rsoconsole.cli.recorded.catalogue._POLL_S", 0.02)
    monkeypatch.setattr("rsoconsole.cli.recorded.catalogue.SLEW_WAIT_S", 0.1)
    verb("add", "celestrak:geo")
    data = status_json(Status(slew_left_s=9.0))
    with ControlServer(default_socket_path(), lambda _request: Outcome(ok=True, data=data)):
        done = CliRunner().invoke(app, ["catalogue", "update"])
    assert "slews" in str(done.exception)
    assert server.asked == []


def test_a_folder_that_is_no_cache_is_said(tmp_path: Path) -> None:
    with pytest.raises(OrbitError, match="is a folder"):
        read_catalogue([tmp_path])


def test_the_cache_is_read_as_sgp4_reads_the_same_elements(night: Night) -> None:
    """Truth: the package sgp4's own reader of two lines, written out again."""
    night.one(send(INTELSAT.encode(), "text/plain"))
    (entry,) = read_catalogue([night.store.folder]).entries
    (direct,) = parse_element_sets(INTELSAT).entries
    assert exporter.export_tle(entry.record) == exporter.export_tle(direct.record)
    assert os.path.commonpath([night.store.folder, *night.store.files()]) == str(night.store.folder)
