"""The verbs orbit and identify, as a shell sees them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.base import OrbitError, SessionError
from rsoconsole.cli.app import app, main
from rsoconsole.cli.words.orbit_words import orbit_lines
from rsoconsole.config import Config
from rsoconsole.orbits import ElementSet, Satellite
from rsoconsole.pipeline import longest_arc, read_observed_tracks
from rsoconsole.records import FollowedAgain, Measurement, TrackState
from rsoconsole.session import SessionWriter
from rsoconsole.sky import IntArray
from rsoconsole.words import NS_PER_S, utc_ns_to_iso
from tests.nights.samples import SAMPLE
from tests.pages.json_page import expect_documented
from tests.truth.seen_satellites import DAYTONA, SHARED, geostationary, instants

OBSERVATIONS, TLES = SHARED / "observations", SHARED / "tles"
needs_shared = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here"),
]
ARCSEC = 1.0 / 3600.0


def run(*arguments: str | Path) -> dict[str, Any]:
    """The one object a verb prints."""
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    (line,) = done.stdout.splitlines()
    expect_documented(str(arguments[0]), json.loads(line))
    return json.loads(line)


def words(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, [*map(str, arguments)])
    assert done.exit_code == 0, done.output
    assert max(len(line) for line in done.stdout.splitlines()) <= 80
    return done.stdout


@pytest.fixture(autouse=True)
def own_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    (tmp_path / "none.toml").write_text("")


class TestRealObservations:
    pytestmark = needs_shared

    def test_gooding_finds_what_orekit_finds(self) -> None:
        found = run("orbit", OBSERVATIONS / "kazsat2_37749.json", "--gooding")
        one_percent = 0.01
        assert found["a_km"] == pytest.approx(42400.558, rel=one_percent)
        assert found["e"] == pytest.approx(0.00450457, abs=1e-4)
        assert found["i_deg"] == pytest.approx(0.0913763, abs=1e-3)
        assert found["method"] == "gooding"
        assert found["label"] == "weak geometry"
        assert len(found["solutions"]) == 1

    def test_ten_minutes_of_a_navigation_satellite_give_an_orbit_that_says_what_it_rests_on(
        self,
    ) -> None:
        found = run("orbit", OBSERVATIONS / "navstar77_43873.json", "--sigma", "0.5")
        assert found["label"] in {"free", "constrained by prior"}
        true_a_km = 26560.0
        assert abs(found["a_km"] - true_a_km) < 3.0 * found["sigma_a_km"]
        assert found["sigma_a_km"] < 0.03 * true_a_km
        assert found["i_deg"] == pytest.approx(55.0, abs=0.2)
        assert found["rms_arcsec"] == pytest.approx(0.5, abs=0.1)
        assert found["observations"] == 77
        assert found["tle"][1].startswith("2 80000  55.")

    @pytest.mark.parametrize(
        ("observation", "elements", "norad_id"),
        [
            ("kazsat2_37749.json", "geo_all_20230622.tle", 37749),
            ("navstar77_43873.json", "meo_20200908.tle", 43873),
        ],
    )
    def test_both_are_named_and_unknown_once_out_of_the_file(
        self, observation: str, elements: str, norad_id: int, tmp_path: Path
    ) -> None:
        at = (OBSERVATIONS / observation, "--tle", TLES / elements)
        found = run("identify", *at)
        assert found["verdict"] == "identified"
        assert found["matches"][0]["norad_id"] == norad_id
        assert found["runner_up"] == found["matches"][1]
        assert found["matches"][0]["score"] < found["runner_up"]["score"]
        page = words("identify", *at)
        assert found["matches"][0]["name"] in page
        assert found["runner_up"]["name"] in page
        lines = (TLES / elements).read_text().splitlines()
        others = [
            line
            for n in range(0, len(lines) - 2, 3)
            if int(lines[n + 1][2:7]) != norad_id
            for line in lines[n : n + 3]
        ]
        (tmp_path / "others.tle").write_text("\n".join(others))
        without = run("identify", at[0], "--tle", tmp_path / "others.tle")
        assert without["verdict"] == "unknown"
        assert without["catalogued"] == found["catalogued"] - 1
        assert len(without["matches"]) > 1


SATELLITE = geostationary(90001, -60.0, name="OURS")


def observation_file(path: Path, rows: Sequence[Any], **other: Any) -> Path:
    site = {"lat_deg": 29.19, "lon_deg": -81.05, "alt_m": 10.0}
    path.write_text(json.dumps({"site": site, "obs": list(rows), "src": "made up", **other}))
    return path


def rows_of(elements: ElementSet, t: IntArray, seed: int = 1) -> list[list[Any]]:
    places = Satellite(elements).astrometric_place(DAYTONA, t)
    noise = np.random.default_rng(seed).normal(0.0, ARCSEC, (len(t), 2))
    return [
        [utc_ns_to_iso(int(t[n]), 6), ra + noise[n, 0], dec + noise[n, 1], 1.0]
        for n, (ra, dec) in enumerate(zip(places.ra_icrs_deg, places.dec_icrs_deg, strict=True))
    ]


@pytest.fixture
def night(tmp_path: Path) -> Path:
    return observation_file(tmp_path / "night.json", rows_of(SATELLITE, instants(0.0)))


@pytest.fixture
def tle(tmp_path: Path) -> Path:
    path = tmp_path / "catalogue.tle"
    other = geostationary(90002, -58.0)
    path.write_text(
        f"OURS\n{SATELLITE.line_1}\n{SATELLITE.line_2}\nOTHER\n{other.line_1}\n{other.line_2}\n"
    )
    return path


KEYS = (
    *("method", "label", "prior", "epoch_utc", "r_gcrs_km", "v_gcrs_km_s", "covariance"),
    *("a_km", "e", "i_deg", "raan_deg", "argp_deg", "m_deg", "sigma_a_km", "rms_arcsec"),
    *("observations", "tle"),
)
MATCH_KEYS = (
    *("norad_id", "name", "separation_arcsec", "cross_track_arcsec", "along_track_s"),
    *("rate_difference_percent", "tle_age_days", "score"),
)


def test_an_orbit_has_every_promised_key_and_says_where_the_satellite_will_be(night: Path) -> None:
    found = run("orbit", night)
    assert set(KEYS) <= set(found)
    assert found["label"] == "constrained by prior"
    assert np.shape(found["covariance"]) == (6, 6)
    in_10_min, in_1_h, in_24_h = found["predicted"]
    for ahead, since_s in ((in_10_min, 600.0), (in_1_h, 3600.0)):
        t = instants(19 * 30.0 + since_s, 1)
        truth = Satellite(SATELLITE).astrometric_place(DAYTONA, t)
        assert ahead["t_utc"] == utc_ns_to_iso(int(t[0]))
        off = np.hypot(
            (ahead["ra"] - truth.ra_icrs_deg[0]) * np.cos(np.radians(ahead["dec"])),
            ahead["dec"] - truth.dec_icrs_deg[0],
        )
        assert off * 3600.0 < 4.0 * ahead["sigma_arcsec"]
    assert in_10_min["sigma_arcsec"] < in_1_h["sigma_arcsec"] < in_24_h["sigma_arcsec"]
    assert found["sets_utc"] is None
    assert found["is_up"]


def test_the_page_for_people_tells_the_same(night: Path) -> None:
    page = words("orbit", night)
    for part in (
        "constrained by prior",
        "semi-major axis",
        "±",
        "in 24 h",
        "does not set within a day",
        "eclipse",
    ):
        assert part in page


def test_its_elements_are_written_for_others_and_put_the_satellite_where_it_was(
    night: Path, tmp_path: Path
) -> None:
    found = run("orbit", night)
    assert len(found["tle"]) == 2
    for name in ("orbit.tle", "orbit.xml", "orbit.json"):
        out = tmp_path / name
        run("orbit", night, "--out", out, "--norad", "36097", "--name", "MINE")
        named = run("identify", night, "--tle", out)
        (best,) = named["matches"]
        assert (best["norad_id"], best["name"]) == (36_097, "MINE")
        assert best["separation_arcsec"] < 2.0
    run("orbit", night, "--out", tmp_path / "orbit.kvn")
    assert "MEAN_ELEMENT_THEORY = SGP4" in (tmp_path / "orbit.kvn").read_text()
    lines = words("orbit", night, "--out", "-").splitlines()
    assert lines == ["UNKNOWN", *found["tle"]]
    assert found["tle"][1] in words("orbit", night)


def test_elements_are_not_written_over_others_nor_of_an_orbit_that_is_not_known(
    night: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "orbit.tle"
    run("orbit", night, "--out", out)
    before = out.read_text()
    capsys.readouterr()
    refused = complaint(capsys, monkeypatch, "orbit", str(night), "--out", str(out))
    assert "is there already: --force writes it again" in refused
    assert out.read_text() == before
    run("orbit", night, "--out", out, "--norad", "5", "--force")
    assert out.read_text() != before
    few = observation_file(tmp_path / "few.json", rows_of(SATELLITE, instants(0.0, 2)))
    none = str(tmp_path / "no.tle")
    assert "no elements to write" in complaint(
        capsys, monkeypatch, "orbit", str(few), "--out", none
    )
    assert not (tmp_path / "no.tle").exists()
    odd = CliRunner().invoke(app, ["orbit", str(night), "--out", str(tmp_path / "no.odt")])
    assert odd.exit_code == 2


def test_a_prior_may_be_asked_for_or_refused(night: Path) -> None:
    assert run("orbit", night, "--prior", "none")["prior"] == "none"
    assert run("orbit", night, "--prior", "meo")["prior"] == "meo"


def test_two_nights_make_one_orbit_and_say_that_they_are_of_one_object(
    night: Path, tmp_path: Path
) -> None:
    second = observation_file(tmp_path / "2.json", rows_of(SATELLITE, instants(87_300.0), 2))
    found = run("orbit", night, second)
    assert found["label"] in {"free", "constrained by prior"}
    assert found["sigma_a_km"] < 1.0
    assert found["observations"] == 40
    first, then = found["parts"]
    assert first["same_object_probability"] is None
    assert then["same_object_probability"] > 0.9
    assert "the same object: " in "\n".join(orbit_lines(["both"], found))


def test_nights_that_part_by_forces_nobody_knows_still_make_an_orbit(
    night: Path, tmp_path: Path
) -> None:
    # The simple theory of the truth and the forces of the fit part by 15 arcsec in five days.
    fifth = observation_file(tmp_path / "5.json", rows_of(SATELLITE, instants(5 * 86_400.0), 3))
    found = run("orbit", night, fifth)
    assert found["label"] in {"free", "constrained by prior"}
    assert found["a_km"] == pytest.approx(42_165.0, abs=5.0)


def test_two_nights_of_two_satellites_are_said_to_be_so(night: Path, tmp_path: Path) -> None:
    other = geostationary(90002, -60.1, i_deg=0.3, node_deg=10.0)
    second = observation_file(tmp_path / "2.json", rows_of(other, instants(87_300.0), 2))
    done = CliRunner().invoke(app, ["orbit", str(night), str(second), "--json"])
    found = json.loads(done.stdout)
    assert found["parts"][1]["same_object_probability"] < 0.01
    assert "2.json is probably of another object" in done.stderr


def test_too_little_to_tell_is_an_answer_and_no_failure(tmp_path: Path) -> None:
    two = observation_file(tmp_path / "two.json", rows_of(SATELLITE, instants(0.0, 2)))
    for more in ((), ("--gooding",)):
        found = run("orbit", two, *more)
        assert found["label"] == "not observable"
        assert found["a_km"] is None
        assert "at least 3" in found["reason"]
    at_once = observation_file(
        tmp_path / "once.json", [rows_of(SATELLITE, instants(0.0, 1))[0]] * 4
    )
    assert run("orbit", at_once)["label"] == "not observable"
    short = observation_file(
        tmp_path / "short.json", rows_of(SATELLITE, instants(0.0, 4, cadence_s=1.0))
    )
    assert run("orbit", short, "--prior", "none")["label"] in {"not observable", "weak geometry"}


def test_a_name_has_every_promised_key(night: Path, tle: Path) -> None:
    found = run("identify", night, "--tle", tle)
    assert found["verdict"] == "identified"
    assert [each["name"] for each in found["matches"]] == ["OURS", "OTHER"]
    assert all(set(MATCH_KEYS) <= set(each) for each in found["matches"])
    page = words("identify", night, "--tle", tle)
    assert "identified" in page
    assert "OTHER" in page


def test_element_files_of_the_configuration_serve_where_none_is_named(
    night: Path, tle: Path, tmp_path: Path
) -> None:
    config = tmp_path / "night.toml"
    config.write_text(f'[catalogue]\ntle_files = ["{tle}"]\n')
    assert run("identify", night, "--config", config)["verdict"] == "identified"


def complaint(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *line: str
) -> str:
    """What the program says on stderr as it ends with 1."""
    monkeypatch.setattr("sys.argv", ["rsoconsole", *line])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    return printed.err


ROW = ["2023-06-09T17:04:59Z", 10.0, 5.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is not JSON"),
        ("[]", "no file of observations"),
        ("{}", "no site"),
        ('{"site": {"lat_deg": 91, "lon_deg": 0}, "obs": []}', "no site"),
        ('{"site": {"lat_deg": 1, "lon_deg": 0}, "obs": []}', "no observations"),
        ([["noon", 1.0, 2.0]], "observation 1: 'noon' is not a time"),
        ([[ROW[0], 10.0]], "observation 1: [time, RA, Dec]"),
        ([[ROW[0], 10.0, 95.0]], "observation 1: 95.0 is not within 90"),
        ([[ROW[0], "10h", 5.0]], "observation 1: '10h' is not a number"),
        ([[*ROW, -1.0]], "observation 1: a sigma must be above 0"),
    ],
)
def test_a_file_that_is_none_is_refused_with_what_is_wrong(
    text: Any, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.json"
    if isinstance(text, list):
        observation_file(path, text)
    else:
        path.write_text(text)
    with pytest.raises(OrbitError) as refused:
        read_observed_tracks(path)
    assert said in str(refused.value)
    assert str(path) in str(refused.value)


def test_what_cannot_be_read_ends_with_one_line(
    night: Path,
    tle: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def said(*line: str | Path) -> str:
        return complaint(capsys, monkeypatch, *map(str, line))

    assert "nowhere.json does not exist" in said("orbit", tmp_path / "nowhere.json")
    assert "holds no session.db" in said("orbit", tmp_path)
    assert "no catalogue" in said("identify", night)
    assert "gone.tle does not exist" in said("identify", night, "--tle", tmp_path / "gone.tle")
    empty = tmp_path / "empty.tle"
    empty.write_text("\n")
    assert "empty.tle holds no element set" in said("identify", night, "--tle", empty)
    broken = tmp_path / "broken.tle"
    broken.write_text(tle.read_text().replace("OTHER\n1 9", "OTHER\n1 8"))
    run = CliRunner().invoke(app, ["identify", str(night), "--tle", str(broken)])
    assert run.exit_code == 0
    assert "1 of 2 element sets is not used" in run.stderr
    assert "broken.tle, line 5" in run.stderr


def test_gooding_of_two_files_is_wrong_usage(night: Path) -> None:
    assert CliRunner().invoke(app, ["orbit", str(night), str(night), "--gooding"]).exit_code == 2


def measurement(frame_id: int, t_utc_ns: int, ra: float, dec: float) -> Measurement:
    return Measurement(
        measurement_id=f"{frame_id}-{ra % 360.0:.6f}",
        frame_id=frame_id,
        t_mid_utc_ns=t_utc_ns,
        ra_icrs_deg=ra % 360.0,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=(0.09, 0.01, 0.04),
        x_px=0.0,
        y_px=0.0,
        confidence=0.9,
        source="network",
    )


def state(
    kind: Any, taken: Measurement, rate_deg_s: float, frame_id: int, track_id: int
) -> TrackState:
    return TrackState(
        track_id=track_id,
        measurement_id=None if kind == "predicted" else taken.measurement_id,
        kind=kind,
        frame_id=frame_id,
        t_utc_ns=taken.t_mid_utc_ns,
        x=(taken.ra_icrs_deg, rate_deg_s, taken.dec_icrs_deg, 0.0),
        P=((1e-9, 0.0, 0.0, 0.0),) * 4,
        innovation_arcsec=(0.0, 0.0) if kind == "updated" else None,
    )


def write_track(
    writer: SessionWriter, first_frame: int, elements: ElementSet, t: IntArray
) -> list[Measurement]:
    """A track of a session with a decoy beside it in every frame."""
    places = Satellite(elements).astrometric_place(DAYTONA, t)
    noise = np.random.default_rng(first_frame).normal(0.0, 0.2 * ARCSEC, (len(t), 2))
    taken: list[Measurement] = []
    for n in range(len(t)):
        frame, at = first_frame + n, int(t[n])
        ra, dec = places.ra_icrs_deg[n] + noise[n, 0], places.dec_icrs_deg[n] + noise[n, 1]
        taken.append(measurement(frame, at, ra, dec))
        writer.append(measurement(frame, at, ra + 0.1, dec - 0.1), at)
        writer.append(taken[-1], at)
        if n == 1:
            dt_s = (at - int(t[0])) / NS_PER_S
            rate = (taken[1].ra_icrs_deg - taken[0].ra_icrs_deg) / dt_s
            slope = (taken[1].dec_icrs_deg - taken[0].dec_icrs_deg) / dt_s
            begun = state("initial", taken[1], rate, frame, first_frame)
            both = (taken[0].measurement_id, taken[1].measurement_id)
            x = (begun.x[0], rate, begun.x[2], slope)
            writer.append(TrackState(**{**_fields(begun), "x": x, "begun_with": both}), at)
        elif n > 1:
            writer.append(state("predicted", taken[n], 0.004, frame, first_frame), at)
            writer.append(state("updated", taken[n], 0.004, frame, first_frame), at)
    return taken


def _fields(track: TrackState) -> dict[str, Any]:
    return {name: getattr(track, name) for name in TrackState.__dataclass_fields__}


@pytest.fixture
def session(tmp_path: Path) -> tuple[Path, list[Measurement], list[Measurement]]:
    """Two tracks: ours, and after a gap a shorter one of another satellite."""
    config = Config.model_validate(
        {"site": {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}}
    )
    writer = SessionWriter.create(tmp_path / "session", config, {"title": "made up"})
    ours = write_track(writer, 1, SATELLITE, instants(0.0, 12))
    other = geostationary(90002, -58.0, i_deg=0.4)
    theirs = write_track(writer, 20, other, instants(1200.0, 8))
    # The operator's word on the last frame: the decoy was the satellite after all.
    last = theirs[-1]
    decoy = measurement(
        last.frame_id, last.t_mid_utc_ns, last.ra_icrs_deg + 0.1, last.dec_icrs_deg - 0.1
    )
    writer.append(FollowedAgain(frame_id=last.frame_id), last.t_mid_utc_ns)
    writer.append(state("predicted", decoy, 0.004, last.frame_id, 20), last.t_mid_utc_ns)
    writer.append(state("updated", decoy, 0.004, last.frame_id, 20), last.t_mid_utc_ns)
    writer.close()
    return tmp_path / "session", ours, [*theirs[:-1], decoy]


def test_a_session_gives_what_each_track_took_with_its_covariance(
    session: tuple[Path, list[Measurement], list[Measurement]],
) -> None:
    folder, *expected = session
    tracks = read_observed_tracks(folder)
    assert [each.tracks for each in tracks] == [2, 2]
    for track, taken in zip(tracks, expected, strict=True):
        assert track.seen.ra_icrs_deg.tolist() == [each.ra_icrs_deg for each in taken]
        assert track.seen.t_utc_ns.tolist() == [each.t_mid_utc_ns for each in taken]
        whitening = track.seen.whitening[0]
        assert np.linalg.inv(whitening.T @ whitening) == pytest.approx(
            np.array([[0.09, 0.01], [0.01, 0.04]])
        )


def test_the_longest_track_of_a_session_is_taken_and_another_satellite_left_out(
    session: tuple[Path, list[Measurement], list[Measurement]], tle: Path
) -> None:
    folder = session[0]
    found = run("orbit", folder)
    assert found["observations"] == 12
    assert [each["is_used"] for each in found["parts"]] == [True, False]
    assert found["parts"][1]["same_object_probability"] < 0.5
    done = CliRunner().invoke(app, ["identify", str(folder), "--tle", str(tle), "--json"])
    report = json.loads(done.stdout)
    assert report["matches"][0]["name"] == "OURS"
    assert [each["track"] for each in report["tracks"]] == [1, 2]
    assert report["tracks"][0]["object_name"] == "OURS"
    assert [each["directions"] for each in report["tracks"]] == [12, 8]
    assert "2 tracks" in done.stderr
    assert "track 1: identified: OURS" in words("identify", folder, "--tle", tle)
    second = run("identify", folder, "--tle", tle, "--track", "2")
    assert second["matches"][0]["name"] == "OTHER"


def test_a_session_without_a_track_says_so(tmp_path: Path) -> None:
    writer = SessionWriter.create(tmp_path / "empty", Config(), {"title": "nothing"})
    writer.append(measurement(1, 1_687_400_000 * NS_PER_S, 10.0, 5.0), 1_687_400_000 * NS_PER_S)
    writer.close()
    with pytest.raises(SessionError, match="holds no track"):
        read_observed_tracks(tmp_path / "empty")


def test_a_track_that_is_not_there_is_named(
    session: tuple[Path, list[Measurement], list[Measurement]],
) -> None:
    with pytest.raises(SessionError, match="tracks 1 to 2, not 3"):
        read_observed_tracks(session[0], track=3)


def test_a_long_silence_parts_arcs(tmp_path: Path) -> None:
    rows = rows_of(SATELLITE, instants(0.0, 5)) + rows_of(SATELLITE, instants(86_400.0, 9))
    (observed,) = read_observed_tracks(observation_file(tmp_path / "both.json", rows))
    assert len(longest_arc(observed.seen)) == 9


def test_the_sample_session_is_intelsat_14(tle: Path) -> None:
    sample = SAMPLE
    found = run("orbit", sample)
    assert found["label"] == "constrained by prior"
    assert found["a_km"] == pytest.approx(42_165.0, abs=3.0 * found["sigma_a_km"])


@pytest.mark.parametrize("is_simulated", [True, False])
def test_a_session_is_identified_by_the_elements_that_it_began_with(
    tmp_path: Path, tle: Path, monkeypatch: pytest.MonkeyPatch, is_simulated: bool
) -> None:
    site = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
    config = Config.model_validate({"site": site, "catalogue": {"tle_files": [str(tle)]}})
    about = {"title": "made up", "is_simulated": is_simulated}
    writer = SessionWriter.create(tmp_path / "session", config, about)
    write_track(writer, 1, SATELLITE, instants(0.0, 12))
    writer.close()
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "session")])
    assert done.exit_code == 0, done.output
    assert "OURS" in done.stdout
    assert f"by the elements that the session was recorded with: {tle}" in done.stderr
    # What the operator has configured is newer than a real night's own, and none of a simulated's.
    other = geostationary(90003, -58.0)
    mine = tmp_path / "mine.tle"
    mine.write_text(f"MINE\n{other.line_1}\n{other.line_2}\n")
    (tmp_path / "none.toml").write_text(f'[catalogue]\ntle_files = ["{mine}"]\n')
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "session"), "--json"])
    best = json.loads(done.stdout)["matches"][0]["name"]
    assert best == ("OURS" if is_simulated else "MINE")
    (tmp_path / "none.toml").write_text("")
    tle.unlink()
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "session")])
    assert f"--tle FILE, or in catalogue.tle_files of the configuration; the session had {tle}" in (
        str(done.exception)
    )
