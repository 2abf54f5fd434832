"""``rso.lightcurve``, the figure and the report's table of a night whose light is known."""

from pathlib import Path

import numpy as np
import pytest

import rsoconsole as rso
from rsoconsole.library import render_report, write_figures
from tests.nights.light_worlds import LightWorld, record_light, sinusoid
from tests.nights.made_up_night import add_frames, armed, begin


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    turn = sinusoid(4.0)

    def light(t_s: object) -> object:
        lit = 9.0 * np.exp(-0.5 * ((np.asarray(t_s) - 203.0) / 0.3) ** 2)
        return turn(t_s) + lit

    folder = tmp_path_factory.mktemp("light") / "night"
    return record_light(folder, LightWorld(light=light, frames=30))


@pytest.fixture(scope="module")
def dark(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dark") / "night"
    writer = begin(folder)
    armed(writer)
    add_frames(writer, range(1, 12))
    writer.close()
    return folder


def test_a_light_curve_has_arrays_period_and_glints(night: Path) -> None:
    curve = rso.lightcurve(night)
    assert curve.track == 1
    assert curve.band == "V"
    assert curve.mag.shape == curve.mag_sigma.shape == curve.time.shape == (30,)
    assert (curve.time[1] - curve.time[0]).sec == pytest.approx(20.0, abs=1.0)
    assert len(curve.steps) == 1200
    assert curve.period is not None
    assert curve.period.period_s == pytest.approx(4.0, rel=0.01)
    assert curve.search.false_alarm_probability < 0.01
    (glint,) = curve.glints
    assert glint.frame_id == 11
    assert "period 4" in repr(curve) or "period 3.99" in repr(curve)
    assert rso.lightcurve(rso.open_session(night), track=1).period == curve.period


def test_a_wrong_track_and_a_night_without_light_are_named(night: Path, dark: Path) -> None:
    with pytest.raises(rso.InputError, match="there is no track 9: there are 1"):
        rso.lightcurve(night, track=9)
    with pytest.raises(rso.SessionError, match="no brightness of track 1 is on record"):
        rso.lightcurve(dark, track=1)
    with pytest.raises(rso.SessionError, match="brightness is on record of no track"):
        rso.open_session(dark).plot_lightcurve()


def test_the_figure_has_the_bright_side_up_and_the_phases(night: Path) -> None:
    figure = rso.lightcurve(night).plot()
    phases, course = figure.axes
    for axis in (phases, course):
        faint, bright = axis.get_ylim()
        assert faint > bright
    assert "Phase of" in phases.get_xlabel()
    assert "Time since" in course.get_xlabel()


def test_figures_and_report_have_the_light_where_there_is_some(
    night: Path, dark: Path, tmp_path: Path
) -> None:
    drawn = write_figures(night, tmp_path / "night")
    assert any(path.name.endswith("_lightcurve.png") for path in drawn)
    without = write_figures(dark, tmp_path / "dark")
    assert not any("lightcurve" in path.name for path in without)

    html = render_report(night).html
    assert 'id="light">Brightness' in html
    assert "double 8" in html or "double 7.99" in html
    assert 'id="figure-lightcurve"' in html
    page = render_report(dark).html
    assert "Brightness" not in page
    assert "figure-lightcurve" not in page
