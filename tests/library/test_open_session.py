"""A session opened in Python: what it shows, its tables, its figures, live and on branches."""

import json
import shutil
import sqlite3
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

import rsoconsole
from rsoconsole.base import ConfigError, ControlError, RsoconsoleError, SessionError
from rsoconsole.library.notebook import session as session_room
from rsoconsole.library.notebook.card import card_text, state_strip_svg
from rsoconsole.library.notebook.figures.figures import NightPlots
from rsoconsole.library.notebook.session import open_session
from rsoconsole.night import StateSpan
from rsoconsole.pipeline.replays.record_equality import are_nearly_equal, is_nearly_equal
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import TABLES, Measurement, OrbitEstimate, Ruling, TrackState
from rsoconsole.session import SessionReader
from rsoconsole.session.log import schema
from tests.nights import made_up_night as made
from tests.nights import orbit_night
from tests.nights.samples import SAMPLE

PLOTS = {"confidence": 1, "track": 2, "about_line": 2, "residuals": 2, "nis": 1}
"""Figures by name, and their panels."""
HEAVY = (
    "numpy",
    "scipy",
    "astropy",
    "pandas",
    "matplotlib",
    "cv2",
    "anywidget",
    "ipywidgets",
    "IPython",
    "traitlets",
    "jupyter_client",
)


@pytest.fixture(scope="module")
def night() -> session_room.Session:
    return open_session(SAMPLE)


# -- what is read, and when ------------------------------------------------------------------


def loaded_by(code: str) -> set[str]:
    """The heavy libraries that a fresh Python has after it has run this."""
    tail = f"\nimport sys, json; print(json.dumps([n for n in {HEAVY!r} if n in sys.modules]))"
    run = subprocess.run(
        [sys.executable, "-c", code + tail], capture_output=True, text=True, check=True
    )
    return set(json.loads(run.stdout.splitlines()[-1]))


def test_importing_the_package_reads_nothing_heavy():
    assert loaded_by("import rsoconsole; rsoconsole.__version__") == set()


def test_the_programs_help_reads_nothing_heavy_and_no_notebook():
    code = (
        "import sys\nfrom rsoconsole.cli.app import app\n"
        "try:\n    app(['--help'])\nexcept SystemExit:\n    pass"
    )
    assert loaded_by(code) <= {"numpy"}  # the records' arrays


def test_the_package_gives_what_it_says_it_has_and_nothing_else():
    for name in rsoconsole.__all__:
        assert getattr(rsoconsole, name) is not None
    with pytest.raises(AttributeError, match="attribute nothing"):
        _ = rsoconsole.nothing


def test_without_the_extra_the_missing_library_and_the_extra_are_named(night, monkeypatch):
    for library in ("pandas", "anywidget"):
        monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(RsoconsoleError, match=r"pandas.*rsoconsole\[notebook\]"):
        night.frame("measurements")
    with pytest.raises(RsoconsoleError, match=r"anywidget.*rsoconsole\[notebook\]"):
        rsoconsole.live_panel()


# -- which session ---------------------------------------------------------------------------


def test_without_a_path_it_is_the_one_written_to_last(tmp_path, monkeypatch):
    config = tmp_path / "config.toml"
    config.write_text(f'[session]\nroot = "{tmp_path / "root"}"\n', encoding="utf-8")
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    with pytest.raises(SessionError, match=r"there is no session in .*rsoconsole demo"):
        open_session()
    # By the time of writing: names begin with the night's own clock, which may be simulated.
    for name in ("z first", "a second"):
        writer = made.begin(tmp_path / "root" / name)
        made.add_frames(writer, range(1, 3))
        writer.close()
    assert open_session().path.name == "a second"


def test_what_is_no_session_is_said(tmp_path):
    with pytest.raises(SessionError, match="does not exist"):
        open_session(tmp_path / "nowhere")
    with pytest.raises(SessionError, match=r"holds no session\.db"):
        open_session(tmp_path)


def test_the_database_itself_may_be_named(night):
    assert open_session(SAMPLE / "session.db").path == night.path


def test_a_session_that_goes_on_is_read_further(tmp_path):
    writer = made.begin(tmp_path / "night")
    made.armed(writer)
    made.add_frames(writer, range(1, 6))
    live = open_session(tmp_path / "night")
    assert (len(live.frames), live.is_closed) == (5, False)
    assert "not closed" in live._repr_html_()
    made.add_frames(writer, range(6, 13))
    writer.close()
    assert len(live.frames) == 5
    assert live.refresh() is live
    assert (len(live.frames), len(live.misses), live.is_closed) == (12, 1, True)
    assert len(live.nights()[0].frames) == 12
    assert "not closed" not in live._repr_html_()


# -- tables ----------------------------------------------------------------------------------


def test_every_public_view_is_a_table(night):
    assert set(night.table_names) >= set(schema.VIEWS)
    with pytest.raises(SessionError, match="no table 'stars'; there are frames"):
        night.table("stars")


def says_the_same(value, told):
    """To the last digit but one for numbers; JSON is read first."""
    if isinstance(value, tuple):
        mine, theirs = np.ravel(value).tolist(), np.ravel(json.loads(told)).tolist()
        return mine == pytest.approx(theirs, rel=1e-14)
    if isinstance(value, float):
        return value == pytest.approx(told, rel=1e-14)
    return value == told


@pytest.mark.parametrize("name", TABLES)
def test_a_table_says_what_the_view_says(name, night, tmp_path):
    """SQL is the other implementation; it may round the last digit."""
    reader = SessionReader(SAMPLE)
    viewed = reader.view_rows(name)
    columns, made_rows = night._rows(name)
    assert len(made_rows) == len(viewed)
    for mine, theirs in zip(made_rows, viewed, strict=True):
        assert set(mine) == {column.name for column in columns}
        assert tuple(theirs) == tuple(column.name for column in columns)
        for column, value in mine.items():
            assert says_the_same(value, theirs[column]), column


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """A night with an orbit and a name after every frame."""
    writer = orbit_night.write(tmp_path_factory.mktemp("orbits") / "night", 20)
    writer.close()
    return open_session(writer.folder)


@pytest.mark.parametrize("name", ["orbits", "identifications"])
def test_a_night_with_orbits_has_a_table_of_them(name, followed):
    columns, made_rows = followed._rows(name)
    assert len(made_rows) > 1
    for mine, theirs in zip(made_rows, SessionReader(followed.path).view_rows(name), strict=True):
        for column in columns:
            assert says_the_same(mine[column.name], theirs[column.name]), column.name
    assert len(followed.table(name)) == len(followed.frame(name)) == len(made_rows)


def test_an_orbits_covariance_is_a_matrix_and_its_sizes_have_units(followed):
    table = followed.orbits
    assert table["covariance"].shape == (len(table), 6, 6)
    exact = [r.covariance for _, _, r in followed.records if isinstance(r, OrbitEstimate)]
    assert np.array_equal(np.asarray(table["covariance"]), exact)
    assert (str(table["a_km"].unit), str(table["vx_gcrs_km_s"].unit)) == ("km", "km / s")
    assert table["observations"].dtype.kind == "i"


@pytest.mark.parametrize("name", TABLES)
def test_a_table_without_rows_has_all_its_columns(name, tmp_path):
    writer = made.begin(tmp_path / "empty")
    writer.close()
    nothing = open_session(tmp_path / "empty")
    named = [column.name.replace("_utc_ns", "_utc") for column in TABLES[name].columns]
    assert nothing.frame(name).shape == (0, len(named))
    assert list(nothing.frame(name).columns) == named
    assert [each for each in nothing.table(name).colnames if each != "direction"] == named


def test_floats_are_those_of_the_log_bit_for_bit(night):
    recorded = [r for _, _, r in night.records if isinstance(r, Measurement)]
    table, frame = night.measurements, night.frame("measurements")
    for column in ("ra_icrs_deg", "dec_icrs_deg", "x_px", "confidence"):
        exact = [getattr(r, column) for r in recorded]
        assert np.asarray(table[column]).tolist() == exact
        assert frame[column].tolist() == exact
    assert [t.value for t in frame["t_mid_utc"]] == [r.t_mid_utc_ns for r in recorded]
    states = [r for _, _, r in night.records if isinstance(r, TrackState)]
    assert np.array_equal(np.asarray(night.track["covariance"]), [r.P for r in states])


def test_units_times_and_directions(night):
    from astropy import units as u
    from astropy.time import Time

    table = night.measurements
    assert table["cov_ee_arcsec2"].unit == u.arcsec**2
    assert table["x_px"].unit == u.pix
    assert night.track["ra_rate_deg_s"].unit == u.deg / u.s
    assert night.timings["ms"].unit == u.ms
    assert night.frames["exposure_s"].to_value("s").tolist() == [10.0] * 36
    assert table["direction"].frame.name == "icrs"
    assert table["direction"][0].ra.deg == pytest.approx(np.asarray(table["ra_icrs_deg"])[0])
    recorded = next(r for _, _, r in night.records if isinstance(r, Measurement))
    there = Time(recorded.t_mid_utc_ns // 10**9, format="unix", scale="utc")
    seconds = (table["t_mid_utc"][0] - there).to_value("s")
    assert seconds == pytest.approx(recorded.t_mid_utc_ns % 10**9 / 1e9, abs=2e-9)


def test_what_is_missing_is_masked_and_never_nan(night):
    nis = night.track["nis"]
    missing = [r.nis is None for _, _, r in night.records if isinstance(r, TrackState)]
    assert nis.mask.tolist() == missing
    assert any(missing)
    assert not all(missing)
    assert night.track["innovation_east_arcsec"].mask.tolist() == missing
    assert night.frames["not_kept_because"].mask.all()


def test_a_table_goes_through_ecsv_and_back_exactly(night, tmp_path):
    from astropy.table import QTable

    table = night.measurements
    table.write(tmp_path / "m.ecsv")
    again = QTable.read(tmp_path / "m.ecsv")
    assert again.colnames == table.colnames
    assert np.array_equal(np.asarray(again["ra_icrs_deg"]), np.asarray(table["ra_icrs_deg"]))
    assert again["t_mid_utc"].isot.tolist() == table["t_mid_utc"].isot.tolist()


def test_empty_tables_have_their_columns(night):
    for name in ("pairs", "expected", "leaps", "low_passes"):
        table, frame = night.table(name), night.frame(name)
        assert len(table) == len(frame) == 0
        assert {"seq", "t_utc", "frame_id"} <= set(table.colnames)
        assert set(frame.columns) <= set(table.colnames)
        assert str(frame["t_utc"].dtype) == "datetime64[ns, UTC]"


def test_an_instant_that_is_missing_is_masked(tmp_path):
    folder = tmp_path / "night"
    shutil.copytree(SAMPLE, folder)
    with sqlite3.connect(folder / "session.db") as database:
        database.execute(
            "UPDATE log SET body = json_set(body, '$.t_start_utc_ns', NULL)"
            " WHERE kind = 'FrameTaken' AND frame_id = 2"
        )
    opened = open_session(folder)
    assert opened.frames["t_start_utc"].mask.tolist() == [n == 2 for n in range(1, 37)]
    assert opened.frame("frames")["t_start_utc"].isna().sum() == 1
    assert len(opened.nights()[0].frames) == 35


# -- what it shows of itself -----------------------------------------------------------------


def test_the_card_has_the_nights_figures(night):
    html = night._repr_html_()
    for words in (
        "intelsat-14 seed 119",
        "2023-06-23 05:30:00 to 05:47:42 UTC",
        "after 4 frames",
        "6 of 32 frames",
        "36, 2 kept in full",
        "TRACK 12 min",
    ):
        assert words in html
    assert "data:image/png;base64," in html
    assert "<script" not in html
    assert "http" not in html.replace("http://www.w3.org", "")
    figures = track_figures(night.replay())
    assert night.summary.residual_rms_arcsec == pytest.approx(figures.residual_rms_arcsec)
    assert night.summary.nis_mean == pytest.approx(figures.nis_mean)
    assert night.summary.nis_band == pytest.approx(figures.nis_band)
    assert night.summary.inside_3sigma == figures.inside_3sigma
    assert f"{figures.residual_rms_arcsec:.2f}″" in html


def test_the_card_is_well_formed_and_a_terminal_has_the_same_words(night):
    html = night._repr_html_()
    root = ElementTree.fromstring(
        html.replace("<br>", "<br/>")
        .replace("&nbsp;", " ")
        .replace('"width:100%;height:auto;margin:0">', '"width:100%;height:auto;margin:0"/>')
    )
    words = "".join(root.itertext())
    text = card_text(night._card())
    for row in text.splitlines()[1:]:
        assert row.split(maxsplit=1)[1].removeprefix("rms").strip()[:8] in words
    assert repr(night).startswith("<Session 'intelsat-14 seed 119', 36 frames")


def test_words_of_the_record_are_escaped(tmp_path):
    evil = '<img src=x onerror="alert(1)">'
    writer = made.begin(tmp_path / "night", title=evil)
    made.add_frames(writer, range(1, 6))
    writer.close()
    shown = open_session(tmp_path / "night")
    changes = shown.what_if(q=1e-3)
    for html in (shown._repr_html_(), changes._repr_html_()):
        assert "<img src=x" not in html
        assert "&lt;img src=x" in html
    strip = state_strip_svg((StateSpan(state=evil, t_from_utc_ns=0, t_to_utc_ns=10),))
    assert "<img" not in strip


def test_a_session_without_frames_shows_itself_all_the_same(tmp_path):
    made.begin(tmp_path / "night").close()
    bare = open_session(tmp_path / "night")
    assert "nothing on record yet" in bare._repr_html_()
    assert "0 frames" in repr(bare)
    assert len(bare.frames) == 0
    with pytest.raises(SessionError, match="nothing to draw"):
        bare.plot_confidence()
    with pytest.raises(SessionError, match="no picture of any frame"):
        bare.picture()


def test_errors_are_one_line_in_a_notebook():
    assert SessionError("it is gone")._render_traceback_() == ["SessionError: it is gone"]


# -- pictures and pixels ---------------------------------------------------------------------


def test_a_picture_comes_with_its_marks_in_pixels_of_the_frame(night):
    picture = night.picture(9)
    assert picture.png.startswith(b"\x89PNG")
    box = ElementTree.fromstring(picture.overlay).find("rect")
    streak = night.frame("detections").set_index("frame_id").loc[9]
    left, width = float(box.get("x")), float(box.get("width"))
    assert (
        left < min(streak.x_a_px, streak.x_b_px) < max(streak.x_a_px, streak.x_b_px) < left + width
    )
    assert "followed with confidence 1.00" in picture.words
    assert night.picture().frame_id == 36


def test_pixels_are_there_for_frames_that_were_kept(night):
    pixels = night.pixels(9)
    assert (pixels.shape, pixels.dtype) == ((1760, 2328), np.uint16)
    with pytest.raises(
        SessionError, match=r"frame 10 were not kept: pruned on 2023-06-23.*; kept: 9, 13"
    ):
        night.pixels(10)


def test_a_streak_is_drawn_where_its_light_is(night):
    upper, lower = night.plot_streak(9).axes
    along, light = lower.get_lines()[0].get_data()
    half = 30.0  # the streak is 60 px long
    inside, outside = light[np.abs(along) < half - 5], light[np.abs(along) > half + 5]
    # 0.6 of the noise a pixel in the mean of seven rows; scatter of the means below 0.1.
    assert np.mean(inside) - np.mean(outside) > 0.4
    assert "SNR 16" in upper.get_title(loc="left")
    with pytest.raises(SessionError, match="nothing was detected in frame 1"):
        night.plot_streak(1)


# -- figures ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "panels"), PLOTS.items())
def test_figures_are_made_without_a_window_and_show_themselves(name, panels, night):
    figure = getattr(night, f"plot_{name}")()
    assert len(figure.axes) == panels
    png, size = figure._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert size["width"] == 660
    assert (
        "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()
    )


def test_a_figure_of_ones_own_is_drawn_into(night):
    from matplotlib.figure import Figure

    mine = Figure(figsize=(4, 3))
    assert night.plot_nis(figure=mine) is mine
    assert len(mine.axes) == 1
    left, right = Figure(layout="constrained").subfigures(1, 2)
    assert night.plot_track(figure=left) is left
    assert len(left.axes) == 2
    assert right.axes == []


def test_a_night_without_a_track_says_so(tmp_path):
    writer = made.begin(tmp_path / "night")
    made.add_frames(writer, range(1, 3))
    writer.close()
    empty = open_session(tmp_path / "night")
    assert len(empty.plot_confidence().axes) == 1
    with pytest.raises(SessionError, match=r"nothing was followed.*plot_confidence"):
        empty.plot_track()


# -- what if ---------------------------------------------------------------------------------


def test_nothing_tried_gives_what_was_recorded(night):
    same = night.what_if()
    # Recorded on another machine, whose processor rounds otherwise.
    assert is_nearly_equal(same.changed, same.recorded)
    recorded, changes = same.nights()
    assert are_nearly_equal(
        [f.updated for f in changes.frames if f.updated],
        [f.updated for f in recorded.frames if f.updated],
    )
    ruled = {r.frame_id for _, _, r in night.records if isinstance(r, Ruling)}
    seen, seen_again = (
        [f.lead_measured for f in each.frames if f.frame_id not in ruled]
        for each in (recorded, changes)
    )
    assert seen_again == seen


def test_what_if_agrees_with_the_consoles(night):
    from rsoconsole.pipeline import what_if

    other = night.what_if(q=1e-3, gate_nis=9.0)
    assert other.settings == {"filter.q_multiplier": 1e-3, "filter.gate_nis": 9.0}
    told = what_if((r for _, _, r in night.records), night.config, other.settings)
    assert other.changed.residual_rms_arcsec == pytest.approx(told.residual_rms_arcsec)
    assert other.changed.nis_mean == pytest.approx(told.nis_mean)
    assert other.changed.misses == told.misses
    assert other.changed != other.recorded


def test_what_if_shows_old_and_new_side_by_side(night):
    other = night.what_if(q=1e-3)
    html = other._repr_html_()
    assert f"{other.recorded.residual_rms_arcsec:.2f}″" in html
    assert f"{other.changed.residual_rms_arcsec:.2f}″" in html
    assert "q_multiplier = 0.001" in repr(other)
    for name, panels in PLOTS.items():
        assert len(getattr(other, f"plot_{name}")().axes) == 2 * panels
    assert isinstance(other, NightPlots)


def test_a_tau_above_everything_follows_nothing_alone_and_is_shown(night):
    assert night.what_if(tau=0.99999).changed.followed > 0, "frames together are sure enough"
    blind = night.what_if(tau=0.99999, preset="paper")
    assert blind.changed.followed == 0
    assert "never" in blind._repr_html_()
    figure = blind.plot_residuals()
    assert len(figure.axes) == 2  # the recorded ones alone


def test_a_setting_that_cannot_be_is_refused(night):
    with pytest.raises(ConfigError, match=r"no setting 'filter\.speed'"):
        night.what_if(speed=3)
    with pytest.raises(ConfigError, match=r"filter.q_multiplier = -1"):
        night.what_if(q=-1)
    with pytest.raises(ConfigError, match="mount"):
        night.what_if({"mount.slew_rate_deg_s": -1.0})


def test_branches_are_sessions_by_name(tmp_path):
    folder = tmp_path / "night"
    shutil.copytree(SAMPLE, folder)
    (folder / "branches" / "figures").mkdir(parents=True)
    branch = folder / "branches" / "loose"
    branch.mkdir()
    shutil.copy(SAMPLE / "session.db", branch)
    with sqlite3.connect(branch / "session.db") as database:
        values = {"branch_of": "../..", "tried": {"filter.q_multiplier": 1e-3}}
        for key, value in values.items():
            database.execute("INSERT INTO meta VALUES (?, ?)", (key, json.dumps(value)))
    night = open_session(folder)
    assert list(night.branches) == ["loose"]
    loose = night.branches["loose"]
    assert "filter.q_multiplier = 0.001; a branch of night" in loose._repr_html_()
    assert len(loose.plot_nis().axes) == 1
    assert len(loose.measurements) == 29


def test_what_was_tried_is_kept_as_a_branch_that_reads_as_it_was(tmp_path):
    folder = tmp_path / "night"
    shutil.copytree(SAMPLE, folder)
    night = open_session(folder)
    changes = night.what_if(q=1e-3)
    assert changes.save("loose") == folder / "branches" / "loose"
    with pytest.raises(SessionError, match="loose"):
        changes.save("loose")
    loose = open_session(folder / "branches" / "loose")
    track = loose.track[loose.track["step"] == "updated"]
    assert list(track["nis"]) == [
        update.nis
        for frame in changes.frames
        for update in frame.records
        if isinstance(update, TrackState) and update.kind == "updated"
    ]
    assert all(frame.is_as_recorded for frame in loose.replay())


@pytest.mark.slow("writes every format twice")
def test_a_night_is_exported_as_the_verb_does(tmp_path):
    night = open_session(SAMPLE)
    direction = f"{float(night.measurements['ra_icrs_deg'][9].value):.8f}"[:-2]
    for name in ("csv", "tdm", "html"):
        path = night.export(name, tmp_path / f"night.{name}")
        assert direction in path.read_text(encoding="utf-8") or name == "html"
        with pytest.raises(RsoconsoleError, match="there already"):
            night.export(name, path)
        assert night.export(name, path, force=True) == path


def test_a_panel_is_on_the_engine_that_writes_this_session(night, tmp_path):
    with pytest.raises(ControlError, match="no engine is running"):
        night.live(socket=tmp_path / "engine.sock")
