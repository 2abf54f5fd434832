"""``doctor --bench``: real stages over a drawn frame, and a verdict that can be no."""

import dataclasses
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError
from rsoconsole.cli.app import app
from rsoconsole.cli.demo.bench import draw_bench_frame
from rsoconsole.config import Config
from rsoconsole.engine import (
    STAGES,
    machine_identity,
    run_benchmark,
    summarise_bench,
    summary_lines,
)
from rsoconsole.engine.doctor import bench
from rsoconsole.engine.doctor.bench import BenchResult, BenchStage, BenchSummary
from rsoconsole.instruments import frame_from_bytes
from rsoconsole.sky import iso_to_utc_ns
from tests.rigs.pi_files import pi_files, put

NOW = iso_to_utc_ns("2023-06-23T00:00:00Z")
PLENTY = 10**12
WIDE, HIGH = 2328, 1760


def settings(root: Path, **more: dict[str, object]) -> Config:
    """Half the paper's sensor behind the same telescope."""
    optics = {"width_px": WIDE, "height_px": HIGH}
    return Config.model_validate({"optics": optics, "session": {"root": str(root)}} | more)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[BenchResult, list[str], Path]:
    """One round, and what was told of it."""
    root = tmp_path_factory.mktemp("bench")
    config, told = settings(root / "nights" / "here"), list[str]()
    result = run_benchmark(
        config,
        draw_bench_frame(config),
        report=told.append,
        budget_s=0.0,
    )
    return result, told, root


def test_the_drawn_frame_is_the_configured_cameras(tmp_path: Path) -> None:
    config = settings(tmp_path, exposure={"exposure_s": 4.0})
    frame = frame_from_bytes(draw_bench_frame(config), 1, "drawn")
    assert (frame.width_px, frame.height_px, frame.exposure_s) == (WIDE, HIGH, 4.0)
    assert frame.scale_arcsec_px == pytest.approx(config.optics.scale_arcsec_px)
    assert frame.pointing_ra_icrs_deg is not None
    assert draw_bench_frame(config) == draw_bench_frame(config)


def test_every_stage_is_measured_once_at_least_however_slow_the_machine(measured) -> None:
    result, told, root = measured
    # The frame has a streak: nothing fainter is looked for.
    seen = [each for each in STAGES if each != "faint"]
    assert [each.stage for each in result.stages] == seen
    assert all(0.0 <= s.least_ms <= s.median_ms <= s.largest_ms for s in result.stages)
    assert [each.repeats for each in result.stages] == [1] * len(seen)
    assert result.notes == ()
    assert result.detections >= 1
    assert result.limiting_mag is not None
    assert 12.0 < result.limiting_mag < 20.0
    assert (result.width_px, result.height_px) == (WIDE, HIGH)
    raw_bytes = 2 * WIDE * HIGH
    assert 0.1 * raw_bytes < result.compressed_bytes < raw_bytes
    assert any(words.startswith("round 1: ") for words in told)
    assert list(root.iterdir()) == [], "it leaves nothing behind and makes no folder"


def test_the_whole_takes_as_long_as_its_parts(measured) -> None:
    result, _, _ = measured
    ms = {each.stage: each.median_ms for each in result.stages}
    assert ms["total"] >= ms["solve"]
    assert ms["total"] + ms["total refit"] >= 2.0 * (ms["read"] + ms["background"] + ms["fit"])


def test_rounds_go_on_while_there_is_time_and_the_first_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = iter([900.0, 3.0, 1.0, 2.0])

    class Instant:
        detections, compressed_bytes, size_px = 1, 1, (1, 1)
        notes = ("once", "once")
        limiting_mag = None

        def __init__(self, *_: object) -> None: ...

        def round(self, _: bytes) -> dict[str, float]:
            return {"total": next(given)}

    monkeypatch.setattr(bench, "_Bench", Instant)
    result = run_benchmark(settings(tmp_path), b"", budget_s=1e9, most_rounds=4)
    expected = BenchStage(stage="total", median_ms=2.0, least_ms=1.0, largest_ms=3.0, repeats=3)
    assert result.stages == (expected,)
    assert result.notes == ("once",)


def test_a_field_without_stars_of_the_index_is_told_and_the_bench_goes_on(tmp_path: Path) -> None:
    optics = {"width_px": 400, "height_px": 300, "focal_length_mm": 6000.0}
    config = Config.model_validate({"optics": optics, "session": {"root": str(tmp_path)}})
    result = run_benchmark(config, draw_bench_frame(config), budget_s=0.0)
    assert any(note.startswith("not solved: ") for note in result.notes)
    assert result.median_ms("solve") is None
    assert summarise_bench(config, result, PLENTY, NOW).processing_s > 0.0


def test_a_disk_that_is_nearly_full_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "free_bytes", lambda _: bench.SPARE_BYTES - 1)
    optics = {"width_px": 400, "height_px": 300, "focal_length_mm": 6000.0}
    config = Config.model_validate({"optics": optics, "session": {"root": str(tmp_path)}})
    result = run_benchmark(config, draw_bench_frame(config), budget_s=0.0)
    assert result.median_ms("disk") is None
    assert "the disk is nearly full: writing was not measured" in result.notes


def test_a_root_that_nothing_can_be_written_in_is_refused_with_its_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder", encoding="ascii")
    config = settings(tmp_path / "file")
    with pytest.raises(SessionError, match=r"set session\.root"):
        run_benchmark(config, b"", budget_s=0.0)


def told(**ms: float) -> BenchResult:
    """A result of so many milliseconds a stage."""
    times = {"total": 800.0, "total refit": 700.0, "compress": 900.0, "disk": 500.0} | ms
    stages = (
        BenchStage(stage=name, median_ms=value, least_ms=value, largest_ms=value, repeats=1)
        for name, value in times.items()
    )
    return BenchResult(
        stages=tuple(stages),
        threads=4,
        width_px=4656,
        height_px=3520,
        detections=1,
        compressed_bytes=10_000_000,
        notes=(),
    )


def verdict(result: BenchResult, **sections: dict[str, object]) -> BenchSummary:
    return summarise_bench(Config.model_validate(sections), result, PLENTY, NOW)


def test_a_cycle_is_the_sum_of_its_parts() -> None:
    found = verdict(told())
    # 0.3 s to the shutter, 10 s exposure, 1 s read-out, 0.8 s work; 3 s and 2 s about a slew of
    # 30 s of the sky's turning at 4 deg/s.
    slew_s = 5.0 + 30 * 15.041 / 3600 / 4
    assert found.slew_s == pytest.approx(slew_s)
    assert found.shortest_cadence_s == pytest.approx(0.3 + 10.0 + 1.0 + 0.8 + slew_s)
    assert found.longest_exposure_s == pytest.approx(30.0 - (found.shortest_cadence_s - 10.0))
    assert found.is_fast_enough
    assert found.disk_mb_s == pytest.approx(20.0)
    assert found.frame_mb == pytest.approx(10.0)
    assert "held" in summary_lines(found)[0]
    assert "NOT" not in " ".join(summary_lines(found))


def test_a_machine_too_slow_for_the_cadence_is_told_which_it_holds() -> None:
    found = verdict(told(total=25_000.0))
    assert not found.is_held
    assert "NOT held" in summary_lines(found)[0]
    assert f"at least {found.shortest_cadence_s:.1f}" in summary_lines(found)[0]
    slower = {"cadence_s": found.shortest_cadence_s + 0.1}
    assert verdict(told(total=25_000.0), exposure=slower).is_held
    hopeless = verdict(told(total=40_000.0))
    assert "no time to expose" in summary_lines(hopeless)[1]


def test_following_may_be_the_slower_way() -> None:
    assert verdict(told(**{"total refit": 1200.0})).processing_s == pytest.approx(1.2)


def test_a_disk_too_slow_for_the_cadence_is_told() -> None:
    found = verdict(told(disk=30_000.0))
    assert (found.is_held, found.is_recorded, found.is_fast_enough) == (True, False, False)
    assert "NOT kept up" in summary_lines(found)[-1]
    none_kept = verdict(told(disk=30_000.0), session={"keep_frames": "none"})
    assert none_kept.is_fast_enough


def test_a_night_is_counted_with_the_frames_real_size() -> None:
    small = verdict(told())
    large = summarise_bench(
        Config(), dataclasses.replace(told(), compressed_bytes=20_000_000), PLENTY, NOW
    )
    assert large.night_mb / small.night_mb == pytest.approx(20.1 / 10.1)


@pytest.mark.parametrize(
    ("architecture", "cpuinfo", "model", "is_emulated"),
    [
        ("x86_64", "vendor_id: AuthenticAMD\nmodel name\t: AMD EPYC\n", "AMD EPYC", False),
        ("aarch64", "vendor_id: AuthenticAMD\nmodel name\t: AMD EPYC\n", "AMD EPYC", True),
        ("aarch64", "CPU implementer\t: 0x00\n", "unnamed aarch64 processor", True),
        ("aarch64", "CPU implementer\t: 0x41\n", "unnamed aarch64 processor", False),
        ("x86_64", "model name\t: QEMU Virtual CPU version 2.5+\n", "QEMU Virtual CPU", True),
    ],
)
def test_a_machine_is_called_what_it_says_it_is(
    tmp_path: Path, architecture: str, cpuinfo: str, model: str, is_emulated: bool
) -> None:
    put(tmp_path, "proc/cpuinfo", cpuinfo)
    put(tmp_path, "etc/os-release", 'PRETTY_NAME="Debian GNU/Linux 12 (bookworm)"')
    here = machine_identity(tmp_path, architecture)
    assert here.model.startswith(model)
    assert here.is_emulated is is_emulated
    assert ("EMULATED" in here.words) is is_emulated
    assert "Raspberry" not in here.words
    assert "Debian GNU/Linux 12 (bookworm)" in here.words
    assert architecture in here.words


def test_a_pi_is_called_one_by_its_device_tree_alone(tmp_path: Path) -> None:
    put(pi_files(tmp_path), "proc/cpuinfo", "CPU implementer\t: 0x41\n")
    here = machine_identity(tmp_path, "aarch64")
    assert (here.model, here.is_emulated) == ("Raspberry Pi 4 Model B Rev 1.4", False)
    put(tmp_path, "proc/sys/fs/binfmt_misc/qemu-aarch64", "enabled\ninterpreter /usr/bin/qemu")
    assert machine_identity(tmp_path, "aarch64").is_emulated


@pytest.fixture
def configured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A configuration file, and a bench that answers at once."""
    path = tmp_path / "config.toml"
    path.write_text(f"[session]\nroot = '{tmp_path}'\n", encoding="utf-8")
    monkeypatch.setattr("rsoconsole.cli.demo.bench.draw_bench_frame", lambda _: b"")
    monkeypatch.setattr(bench, "run_benchmark", lambda *_, **__: told())
    monkeypatch.setattr("rsoconsole.engine.machine.machine_name.load_share", lambda: 0.0)
    return path


def test_the_table_names_machine_stages_and_verdict(configured: Path) -> None:
    run = CliRunner().invoke(app, ["doctor", "--bench", "--config", str(configured)])
    assert run.exit_code == 0
    lines = run.stdout.splitlines()
    assert lines[0] == machine_identity().words
    assert any(line.split()[:2] == ["total", "800.0"] for line in lines)
    assert any(line.startswith("exposures of 10 s every 30 s: held") for line in lines)
    assert "1 streak detected, session.root on" in lines[1]
    assert "note:" not in run.stdout


def test_the_table_says_how_faint_a_star_the_frame_shows(
    configured: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["doctor", "--bench", "--config", str(configured)]
    measured = dataclasses.replace(told(), limiting_mag=13.94)
    monkeypatch.setattr(bench, "run_benchmark", lambda *_, **__: measured)
    assert "detected, stars to 13.9 mag, session.root on" in CliRunner().invoke(app, words).stdout
    as_json = CliRunner().invoke(app, [*words, "--json"]).stdout
    assert json.loads(as_json.splitlines()[0])["limiting_mag"] == 13.94


def test_json_is_machine_stages_and_verdict_and_a_no_is_exit_1(
    configured: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "run_benchmark", lambda *_, **__: told(total=99_000.0))
    monkeypatch.setattr("rsoconsole.engine.machine.machine_name.load_share", lambda: 0.9)
    run = CliRunner().invoke(app, ["doctor", "--bench", "--json", "--config", str(configured)])
    assert run.exit_code == 1
    rows = [json.loads(line) for line in run.stdout.splitlines()]
    assert [row["kind"] for row in rows] == ["machine", *["stage"] * 4, "verdict"]
    assert rows[0]["threads"] == 4
    assert "90% of the cores" in rows[0]["notes"][0]
    assert rows[1] == {
        "schema": 1,
        "kind": "stage",
        "stage": "total",
        "median_ms": 99_000.0,
        "least_ms": 99_000.0,
        "largest_ms": 99_000.0,
        "repeats": 1,
    }
    assert rows[-1]["ok"] is False
    assert rows[-1]["is_held"] is False
