"""Each check of the arming list passes in a good night and has something that fails it."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine import CHECKS
from rsoconsole.engine.doctor import doctor, doctor_system
from rsoconsole.engine.doctor.doctor_system import ClockReading
from rsoconsole.engine.operator.arming import (
    ArmingFacts,
    arming_checks,
    gather_facts,
    pointing_check,
    refusal_text,
)
from rsoconsole.instruments import Instruments, MountAbilities, MountReport, SiteCheck, SkyReport
from rsoconsole.records import NotSolved, Site, Solution, Wcs
from rsoconsole.sky import iso_to_utc_ns

MIDNIGHT = iso_to_utc_ns("2023-06-22T05:30:00Z")
"""In Daytona Beach, the default site."""
NOON = iso_to_utc_ns("2023-06-22T17:30:00Z")
CONFIG = Config.model_validate({"indi": {"weather": "Vane", "dome": "Roof"}})
REPORT = MountReport(
    t_utc_ns=MIDNIGHT,
    ra_icrs_deg=359.9,
    dec_icrs_deg=-5.0,
    is_slewing=False,
    is_parked=False,
    is_tracking=True,
    pier_side="east",
)
HERE = SiteCheck(
    is_consistent=True,
    reported=Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0),
    detail="the mount stands at the configured site",
)
FACTS = ArmingFacts(
    now_utc_ns=MIDNIGHT,
    is_simulated=False,
    clock=ClockReading(is_synchronised=True, offset_s=0.002, max_error_s=0.03),
    site=HERE,
    report=REPORT,
    mount_fault="",
    mount_utc_offset_s=-0.8,
    abilities=MountAbilities(),
    sky=SkyReport(weather="ok", dome="open"),
    free_bytes=500 * 10**9,
    disk_fault="",
    network=doctor.CheckResult(check="network", ok=True, detail="streak_ssd 1"),
    index=doctor.CheckResult(check="index files", ok=True, detail="6 files"),
)


def with_(**changes: Any) -> ArmingFacts:
    return dataclasses.replace(FACTS, **changes)


def parked() -> MountReport:
    return dataclasses.replace(REPORT, is_parked=True)


def solved(ra_icrs_deg: float, dec_icrs_deg: float) -> Solution:
    wcs = Wcs(
        crpix_x_px=0.0, crpix_y_px=0.0, crval_ra_deg=0.0, crval_dec_deg=0.0, cd=(1.0, 0.0, 0.0, 1.0)
    )
    return Solution(
        frame_id=1,
        wcs=wcs,
        ra_icrs_deg=ra_icrs_deg,
        dec_icrs_deg=dec_icrs_deg,
        scale_arcsec_px=1.26,
        rotation_deg=0.0,
        is_flipped=False,
        matched=30,
        rms_arcsec=0.5,
        path="full",
        ms=100.0,
    )


def test_in_a_good_night_every_check_passes_and_says_its_figure() -> None:
    checks = arming_checks(FACTS, CONFIG)
    assert tuple(check.name for check in checks) == CHECKS[:-1]
    assert [check.name for check in checks if not check.ok] == []
    assert all(check.detail and not check.remedy for check in checks)
    assert refusal_text(checks, ()) is None
    told = {check.name: check.detail for check in checks}
    assert "+2.000 ms" in told["clock"]
    assert "-0.8 s" in told["time"]
    assert "until 2023-06-22T09:2" in told["sun"]
    assert "500.0 GB free, 3.9 h" in told["disk"]


@pytest.mark.parametrize(
    ("facts", "name", "says"),
    [
        (with_(clock=ClockReading(is_synchronised=False)), "clock", "not synchronised"),
        (with_(clock=ClockReading(is_synchronised=None)), "clock", "does not tell"),
        (
            with_(clock=ClockReading(is_synchronised=True, offset_s=-0.4)),
            "clock",
            "-400.000 ms",
        ),
        (
            with_(
                site=SiteCheck(
                    is_consistent=False,
                    reported=HERE.reported,
                    detail="42 km off",
                )
            ),
            "site",
            "42 km",
        ),
        (with_(site=None, mount_fault="it hung"), "site", "it hung"),
        (with_(mount_utc_offset_s=3600.0), "time", "+3600.0 s"),
        (with_(mount_utc_offset_s=-31.0), "time", "-31.0 s"),
        (with_(now_utc_ns=NOON), "sun", "above the limit of -12.0"),
        (with_(report=parked()), "unparked", "parked"),
        (with_(abilities=MountAbilities(can_abort=False)), "abort", "cut its power"),
        (
            with_(abilities=MountAbilities(can_set_tracking=False, can_park=False)),
            "tracking",
            "cannot be ended at a limit",
        ),
        (with_(sky=SkyReport(weather="alert", dome="open")), "weather", "alert"),
        (with_(sky=SkyReport(weather="silent", dome="open")), "weather", "silent"),
        (with_(sky=SkyReport(weather="ok", dome="closed")), "dome", "closed"),
        (with_(sky=SkyReport(weather="ok", dome="moving")), "dome", "moving"),
        (with_(free_bytes=10**9), "disk", "1.0 GB free"),
        (with_(disk_fault="Read-only file system"), "disk", "Read-only"),
        (with_(free_bytes=None), "disk", "unknown"),
        (
            with_(
                network=doctor.CheckResult(check="network", ok=False, detail="gone", remedy="again")
            ),
            "network",
            "gone",
        ),
        (
            with_(
                index=doctor.CheckResult(check="index files", ok=False, detail="9", remedy="get")
            ),
            "index",
            "9",
        ),
    ],
)
def test_each_check_is_failed_by_what_it_is_there_for_and_overridden_by_its_name(
    facts: ArmingFacts, name: str, says: str
) -> None:
    checks = arming_checks(facts, CONFIG)
    (failed,) = [check for check in checks if not check.ok]
    assert failed.name == name
    assert says in failed.detail
    assert failed.remedy
    refusal = refusal_text(checks, set(CHECKS) - {name})
    assert refusal is not None
    assert f"{name}: {failed.detail}" in refusal
    assert failed.remedy in refusal
    assert f"--override {name}" in refusal
    assert "\n" not in refusal
    assert refusal_text(checks, {name}) is None


def test_a_mount_that_says_nothing_fails_what_only_it_can_tell() -> None:
    dumb = with_(report=None, site=None, mount_utc_offset_s=None, mount_fault="no answer in 0.5 s")
    failed = [check for check in arming_checks(dumb, CONFIG) if not check.ok]
    assert [check.name for check in failed] == ["site", "time", "unparked", "abort", "tracking"]
    assert all("no answer in 0.5 s" in check.detail for check in failed)


def test_what_a_mount_need_not_tell_is_not_asked_of_it() -> None:
    quiet = SiteCheck(is_consistent=True, reported=None, detail="not told")
    checks = arming_checks(with_(site=quiet, mount_utc_offset_s=None), CONFIG)
    assert all(check.ok for check in checks)
    assert "does not tell" in next(check.detail for check in checks if check.name == "time")


@pytest.mark.parametrize(
    ("abilities", "name", "says"),
    [
        (MountAbilities(can_set_tracking=False), "tracking", "it parks there"),
        (MountAbilities(can_park=False), "unparked", "dawn only stops it"),
        (MountAbilities(has_pier_side=False), "unparked", "from the hour angle"),
    ],
)
def test_what_a_mount_cannot_is_told_where_the_night_can_do_without(
    abilities: MountAbilities, name: str, says: str
) -> None:
    checks = arming_checks(with_(abilities=abilities), CONFIG)
    assert all(check.ok for check in checks)
    assert says in next(check.detail for check in checks if check.name == name)


def test_a_mount_on_its_way_to_its_park_position_may_be_armed_and_that_is_said() -> None:
    parking = dataclasses.replace(REPORT, is_slewing=True, is_parking=True)
    checks = arming_checks(with_(report=parking), CONFIG)
    assert all(check.ok for check in checks)
    told = next(check.detail for check in checks if check.name == "unparked")
    assert "arming ends that" in told


def test_a_mount_that_does_not_tell_what_it_can_is_not_armed() -> None:
    untold = with_(abilities=None, mount_fault="no such order")
    failed = [check for check in arming_checks(untold, CONFIG) if not check.ok]
    assert [check.name for check in failed] == ["abort", "tracking"]
    assert all("no such order" in check.detail for check in failed)


def test_the_simulated_clock_is_always_right_and_nothing_else_is() -> None:
    lost = with_(is_simulated=True, clock=ClockReading(is_synchronised=False), report=parked())
    failed = [check.name for check in arming_checks(lost, CONFIG) if not check.ok]
    assert failed == ["unparked"]


def test_weather_and_dome_are_asked_for_only_where_they_are_configured() -> None:
    assert all(check.ok for check in arming_checks(with_(sky=None), Config()))
    failed = [check.name for check in arming_checks(with_(sky=None), CONFIG) if not check.ok]
    assert failed == ["weather", "dome"]


def test_a_warning_of_the_weather_station_is_told_and_does_not_refuse() -> None:
    checks = arming_checks(with_(sky=SkyReport(weather="warning", dome="open")), CONFIG)
    weather = next(check for check in checks if check.name == "weather")
    assert weather.ok
    assert "warning" in weather.detail


def test_one_line_names_all_that_fails_and_only_that() -> None:
    checks = arming_checks(with_(now_utc_ns=NOON, report=parked()), CONFIG)
    refusal = refusal_text(checks, {"clock"})
    assert refusal is not None
    assert refusal.endswith("--override sun --override unparked")
    assert "disk:" not in refusal
    assert "wait until 2023-06-23T01:2" in refusal
    half = refusal_text(checks, {"sun"})
    assert half is not None
    assert half.endswith(": --override unparked")


@pytest.mark.parametrize(
    ("ra_icrs_deg", "dec_icrs_deg", "ok", "says"),
    [
        (359.9, -5.0, True, "0.0 arcmin"),
        (0.4, -5.0, True, "29.9 arcmin"),  # 0.5 deg over RA 0h, times cos 5 deg
        (359.9, -4.02, True, "58.8 arcmin"),
        (359.9, -3.9, False, "66.0 arcmin"),
        (1.2, -5.0, False, "77.7 arcmin"),
        (179.9, 5.0, False, "10800.0 arcmin"),
    ],
)
def test_stars_are_where_the_mount_says_it_looks(
    ra_icrs_deg: float, dec_icrs_deg: float, ok: bool, says: str
) -> None:
    check = pointing_check(solved(ra_icrs_deg, dec_icrs_deg), REPORT, CONFIG)
    assert (check.name, check.ok) == ("pointing", ok)
    assert says in check.detail
    assert bool(check.remedy) != ok


@pytest.mark.parametrize(
    ("solution", "report", "says"),
    [
        (None, REPORT, "no frame"),
        (NotSolved(frame_id=7, reason="2 stars, 8 needed", ms=3.0), REPORT, "2 stars, 8 needed"),
        (solved(359.9, -5.0), None, "does not say"),
    ],
)
def test_without_stars_or_mount_the_pointing_is_not_known(solution, report, says) -> None:
    check = pointing_check(solution, report, CONFIG)
    assert not check.ok
    assert says in check.detail
    assert check.remedy
    refusal = refusal_text([check], ())
    assert refusal is not None
    assert "--override pointing" in refusal


# ---- asking the world ----------------------------------------------------------------------


class StubMount:
    """Answers as told; an exception is raised instead."""

    def __init__(self, **answers: Any) -> None:
        told = {"report": REPORT, "check_site": HERE, "utc_offset_s": 0.2}
        self.answers = {**told, "abilities": MountAbilities(), **answers}
        self.asked: list[str] = []

    def __getattr__(self, question: str) -> Any:
        def answer(*_: Any, **__: Any) -> Any:
            self.asked.append(question)
            value = self.answers[question]
            if isinstance(value, Exception):
                raise value
            return value

        return answer


class StubClock:
    is_simulated = False

    def now_utc_ns(self) -> int:
        return MIDNIGHT


class StubSafetyMonitor:
    def __init__(self, fault: Exception | None = None) -> None:
        self.fault = fault

    def look(self) -> SkyReport:
        if self.fault:
            raise self.fault
        return SkyReport(weather="ok", dome="open")


def instruments(mount: StubMount, safety_monitor: Any = None) -> Instruments:
    stubs: Any = {
        "clock": StubClock(),
        "mount": mount,
        "camera": None,
        "safety_monitor": safety_monitor,
    }
    return Instruments(
        **stubs, host="127.0.0.1", port=7624, mount_name="mount", camera_name="camera"
    )


def test_the_world_is_asked_and_its_answers_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_system, "read_clock", lambda: FACTS.clock)
    facts = gather_facts(instruments(StubMount(), StubSafetyMonitor()), CONFIG, tmp_path / "new")
    assert facts.now_utc_ns == MIDNIGHT
    assert (facts.report, facts.site, facts.mount_utc_offset_s) == (REPORT, HERE, 0.2)
    assert facts.sky == SkyReport(weather="ok", dome="open")
    assert facts.free_bytes is not None
    assert facts.free_bytes > 0
    assert (facts.mount_fault, facts.disk_fault) == ("", "")
    checks = arming_checks(with_(network=facts.network, index=facts.index), CONFIG)
    assert all(check.ok for check in checks)
    assert not (tmp_path / "new").exists()


def test_questions_that_fail_become_failed_checks_never_exceptions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> Any:
        raise OSError("no such device")

    for name in ("read_clock", "free_bytes", "write_fault"):
        monkeypatch.setattr(doctor_system, name, broken)
    for name in ("check_network", "check_index_files"):
        monkeypatch.setattr(doctor, name, broken)
    mount = StubMount(report=InstrumentError("the mount's process died"))
    safety_monitor = StubSafetyMonitor(RuntimeError("gone"))
    facts = gather_facts(instruments(mount, safety_monitor), CONFIG, tmp_path)
    assert mount.asked == ["report"]  # a dead mount is waited for once
    failed = {check.name: check.detail for check in arming_checks(facts, CONFIG) if not check.ok}
    assert set(failed) == set(CHECKS) - {"sun", "pointing"}
    assert "the mount's process died" in failed["unparked"]
    assert "no such device" in failed["disk"]


def test_a_mount_whose_clock_cannot_be_asked_counts_as_one_that_has_none(tmp_path: Path) -> None:
    mount = StubMount(utc_offset_s=InstrumentError("no such order"))
    facts = gather_facts(instruments(mount), CONFIG, tmp_path)
    assert facts.mount_utc_offset_s is None
    assert next(c for c in arming_checks(facts, CONFIG) if c.name == "time").ok


def test_a_mount_that_fails_at_its_site_is_quoted(tmp_path: Path) -> None:
    mount = StubMount(check_site=InstrumentError("the mount is silent"))
    facts = gather_facts(instruments(mount), CONFIG, tmp_path)
    site = next(c for c in arming_checks(facts, CONFIG) if c.name == "site")
    assert not site.ok
    assert "the mount is silent" in site.detail


def test_a_session_folder_where_nothing_can_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    facts = gather_facts(instruments(StubMount()), CONFIG, tmp_path / "file")
    disk = next(c for c in arming_checks(facts, CONFIG) if c.name == "disk")
    assert not disk.ok
    assert "no folder" in disk.detail
