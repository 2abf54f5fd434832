"""The report of a night: one file, nothing outside it, nothing in it that was not recorded."""

import base64
import re
from collections import Counter
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import SessionError
from rsoconsole.library import render_report
from rsoconsole.library.formats.night import read_exported_night as read_rows
from rsoconsole.library.notebook.night.night import read_drawn_night
from rsoconsole.library.notebook.report._report_pictures import MAX_PICTURES, choose_frames
from rsoconsole.night import lead_summary
from rsoconsole.pipeline import replay
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import (
    Cause,
    Event,
    OperatorAction,
    ParameterChange,
    StateChange,
    done_result,
)
from rsoconsole.session import SessionReader
from tests.nights.export_nights import MISSED, T0, closed_night, written_night
from tests.nights.leap_samples import leap_of, pass_of
from tests.nights.measured_night import record_night
from tests.nights.pair_records import expected_of, pair_of, pairs_of, unseen_of
from tests.nights.samples import SAMPLE

MAX_BYTES = 8_000_000
NASTY = '<script>alert("x")</script> & $x^{ <img src=http://e.vil/x> ${{7*7}} {{ 7*7 }}'
VOID = {"meta", "br", "img", "link", "hr", "input"}


class Page(HTMLParser):
    """Elements of a page, and whether each that opens closes in order."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: Counter[str] = Counter()
        self.attributes: list[tuple[str, str, str]] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags[tag] += 1
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags[tag] += 1
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag):
        assert self._open, f"</{tag}> closes nothing"
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)

    def of(self, name: str, tag: str | None = None) -> list[str]:
        return [v for t, n, v in self.attributes if n == name and tag in (None, t)]

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


@pytest.fixture(scope="module")
def sample_html() -> str:
    return render_report(SAMPLE).html


@pytest.fixture(scope="module")
def sample(sample_html: str) -> Page:
    return Page(sample_html)


@pytest.fixture(scope="module")
def nasty(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, str]:
    """A night in whose every text somebody has written markup."""
    folder = tmp_path_factory.mktemp("night") / "nasty"
    about = {"title": NASTY, "branch_of": "../..", "tried": {"filter.gate_nis": NASTY}}
    writer = written_night(folder, about=about)
    writer.append(Event(level="alarm", text=NASTY, frame_id=3), T0)
    arguments = {"text": NASTY}
    writer.append(
        OperatorAction(verb="note", arguments=arguments, outcome=done_result(NASTY), by=NASTY), T0
    )
    writer.append(ParameterChange(name="x", before=NASTY, after=2.0, by=NASTY), T0)
    writer.append(
        StateChange(
            frame_id=3, before="IDLE", after="SEARCH", reason=Cause(kind="instrument", detail=NASTY)
        ),
        T0,
    )
    writer.close()
    html = render_report(folder).html
    return Page(html), html


def assert_stands_alone(page: Page) -> None:
    assert page.tags["script"] == page.tags["link"] == page.tags["iframe"] == 0
    assert not [name for _, name, _ in page.attributes if name.startswith("on")]
    for source in page.of("src"):
        assert source.startswith("data:image/jpeg;base64,")
        assert base64.b64decode(source.partition(",")[2])[:2] == b"\xff\xd8"
    for _, name, value in page.attributes:
        if name.endswith("href"):
            assert value.startswith("#")
        if name not in {"src", "content"}:
            assert not re.search(r"(?:https?:)?//", value), (name, value)
        for inner in re.findall(r"url\(([^)]*)\)", value):
            assert inner.startswith("#")
    (policy,) = [v for v in page.of("content") if "default-src" in v]
    assert "default-src 'none'" in policy


def test_it_asks_for_nothing_outside_itself(sample: Page, nasty):
    assert_stands_alone(sample)
    assert_stands_alone(nasty[0])
    style = (
        files("rsoconsole.library.notebook")
        .joinpath("templates/report.css")
        .read_text(encoding="utf-8")
    )
    assert "url(" not in style
    assert "@import" not in style


def test_what_people_wrote_is_text_and_never_markup(nasty):
    page, html = nasty
    assert "<script" not in html
    assert page.text.count('<script>alert("x")</script>') >= 7
    assert "{{ 7*7 }}" in page.text
    assert page.tags["h1"] == 1


def test_every_reference_inside_the_page_leads_somewhere(sample: Page, nasty):
    for page in (sample, nasty[0]):
        ids = page.of("id")
        assert len(ids) == len(set(ids))
        asked = {value[1:] for _, name, value in page.attributes if name.endswith("href")}
        asked |= {inner[1:] for v in page.of("clip-path") for inner in re.findall(r"\((.*?)\)", v)}
        asked |= set(page.of("aria-labelledby"))
        assert asked
        assert asked <= set(ids)


def test_every_picture_says_in_words_what_it_shows(sample: Page):
    assert len(sample.of("alt", "img")) == sample.tags["img"] == 36
    assert all(alt.startswith("Exposure ") for alt in sample.of("alt", "img"))
    assert sample.of("aria-labelledby", "svg") == [
        f"figure-{name}"
        for name in ("confidence", "track", "about_line", "residuals", "nis", "lightcurve")
    ]
    assert sample.of("role", "svg") == ["img"] * 6
    assert sample.of("lang", "html") == ["en"]
    assert {"scope"} <= {name for tag, name, _ in sample.attributes if tag == "th"}


def test_it_says_what_the_record_says(sample: Page):
    text = sample.text
    rows = read_rows(SAMPLE).rows
    figures = track_figures(replay([r for _, _, r in SessionReader(SAMPLE).records()], _config()))
    assert "One object was followed from 05:31:05 to 05:47:05 UTC" in text
    times = sum(row.is_taken for row in rows)
    assert f"measured {times} times in 36 exposures, with 6 misses" in text
    assert "It moves as a geostationary satellite does." in text
    assert f"within {figures.residual_rms_arcsec:.2f} arcsec" in text
    assert f"{figures.nis_mean:.2f} {'✓' if figures.is_nis_sound else '✗'} its band" in text
    assert "simulated: no telescope observed this" in text
    assert "ACQUIRE → TRACK: two frames agree on one motion" in text
    assert "20:54:13.285" in text
    assert "−04:47:02.80" in text
    assert "−0.00" not in text


def _config():
    return SessionReader(SAMPLE).config()


def test_it_says_how_tracks_moved_to_each_other_and_who_was_expected_in_vain(tmp_path: Path):
    """By the words of the section: figures of what is on record, the nearest pair first."""
    writer = written_night(tmp_path / "field")
    for n, apart in ((5, 90.0), (6, 60.0), (7, 75.0)):
        near = pair_of(n, 1, 2, separation_arcsec=apart)
        far = pair_of(n, 1, 3, closest="beyond", separation_arcsec=400.0 - n)
        writer.append(pairs_of(n, near, far), T0 + 30 * n * 10**9)
        gone = unseen_of("<b>ASTRA</b> 1H", is_lit=n < 7)
        writer.append(expected_of(n, *([gone] if n > 5 else [])), T0 + 30 * n * 10**9)
    writer.close()
    html = render_report(tmp_path / "field").html
    page = Page(html)
    said = " ".join(" ".join(page.texts).split())
    assert "The field" in said
    section = said[said.index("How tracks moved") :]
    first, second = section.index("1, 2 "), section.index("1, 3 ")
    assert first < second
    assert "75.00 ± 0.50" in section[first:second]
    assert "60.00 at" in section[first:second]
    assert "61.0″ (41.0 to 90.0) at" in section[first:second]
    assert "still approaching" in section[second:]
    assert "<b>ASTRA</b> 1H 25785 2 of 3 1" in section
    assert "<b>ASTRA" not in html


def test_a_night_of_one_track_has_no_section_of_the_field(sample: Page):
    assert "The field" not in sample.texts


def test_it_says_what_came_of_each_pass_and_of_its_leaps(tmp_path: Path):
    writer = written_night(tmp_path / "low")
    for n in range(1, 6):
        off = {"off_along_arcsec": 10.0 * n, "off_across_arcsec": -0.5 * n}
        missed = {"result": "another streak", "off_along_arcsec": None, "off_across_arcsec": None}
        writer.append(leap_of(n, **(off if n != 2 else missed)), T0 + 5 * n * 10**9)
    writer.append(pass_of(name="<b>COSMOS</b> 1"), T0 + 30 * 10**9)
    # One of which a single streak is all: no orbit, nothing planned, no next pass.
    none = "epoch_utc_ns r_gcrs_km v_gcrs_km_s covariance a_km e i_deg along_rms_arcsec"
    none += " across_rms_arcsec t_next_rise_utc_ns sigma_next_s sigma_next_across_deg scatter_s"
    nothing = dict.fromkeys(none.split())
    lone = pass_of(begun_frame_id=40, streaks=1, planned_leaps=0, ended="given up", **nothing)
    writer.append(lone, T0 + 60 * 10**9)
    writer.close()
    html = render_report(tmp_path / "low").html
    said = " ".join(" ".join(Page(html).texts).split())
    section = said[said.index("Passes of low satellites") :]
    assert "<b>COSMOS</b> 1" in section
    assert "<b>COSMOS" not in html
    assert "5 streaks in 29 s it sets 4 of 5 (1 another streak) 6 35 1.8" in section
    assert "6928 km, e 0.0015 (a prior in it), i 53.00° 1.2, 0.8 0.125" in section
    assert "± 3.5 s, ± 0.02° across" in section
    assert "not expected" in section
    assert "given up 0 of 0 0 – – one streak: none – – not within a day" in section
    assert "2 of 5 5.00 2.25 2.00 0.25 0.25 0.00 0.25" in section


def test_a_night_without_leaps_has_no_section_of_passes(sample: Page):
    assert "Passes of low satellites" not in sample.texts


def test_its_figures_are_those_that_a_replay_gives(tmp_path: Path):
    folder = record_night(tmp_path / "night", frames=30, seed=3, missed=frozenset({20, 21}))
    reader = SessionReader(folder)
    replayed = track_figures(replay((r for _, _, r in reader.records()), reader.config()))
    said = lead_summary(read_drawn_night(folder).frames)
    assert (said.updates, said.misses) == (replayed.updates, replayed.misses)
    for name in ("residual_rms_arcsec", "nis_mean", "nis_band", "inside_3sigma"):
        assert getattr(said, name) == pytest.approx(getattr(replayed, name))  # another order


def test_rings_lie_on_the_streaks(sample: Page):
    rows = [row for row in read_rows(SAMPLE).rows if row.is_taken]
    styles = [
        dict(part.split(":") for part in style.split(";"))
        for (tag, name, style), (_, _, kind) in zip(
            [a for a in sample.attributes if a[0] == "i" and a[1] == "style"],
            [a for a in sample.attributes if a[0] == "i" and a[1] == "class"],
            strict=True,
        )
        if kind == "taken"
    ]
    assert len(styles) == len(rows)
    for row, style in zip(rows, styles, strict=True):
        assert float(style["left"][:-1]) == pytest.approx((row.x_px + 0.5) / 23.28, abs=0.01)
        assert float(style["top"][:-1]) == pytest.approx((row.y_px + 0.5) / 17.60, abs=0.01)


def test_flags_stand_where_a_reader_meets_them_first(tmp_path: Path, nasty):
    assert "a branch of what was recorded, with filter.gate_nis =" in nasty[0].text
    writer = written_night(tmp_path / "live", frames=1)
    try:
        text = Page(render_report(writer.folder).html).text
    finally:
        writer.close()
    assert "not closed: the session is live, or was cut off" in text


def test_a_night_in_which_nothing_was_followed(tmp_path: Path):
    page = Page(render_report(closed_night(tmp_path / "short", frames=1)).html)
    assert "Nothing was followed: 1 exposure, something was measured in 1 of them." in page.text
    assert page.tags["svg"] == 1
    with pytest.raises(SessionError, match="no frame with a time"):
        render_report(closed_night(tmp_path / "empty", frames=0))


def test_pictures_keep_to_their_budget_and_no_missed_frame_is_left_out(tmp_path: Path):
    writer = written_night(tmp_path / "long", frames=90)
    noise = np.random.default_rng(1).integers(0, 255, (350, 466), dtype=np.uint8)
    for frame_id in range(1, 91):
        assert writer.save_preview(frame_id, noise)
        if frame_id % 10 == 0:
            assert writer._previews.drain(20.0)
    writer.close()
    (writer.folder / "previews" / "000001.png").write_bytes(b"no picture")
    html = render_report(writer.folder).html
    page = Page(html)
    assert len(html) < MAX_BYTES
    shown = {int(alt.split()[1]) for alt in page.of("alt", "img")}
    assert set(MISSED) <= shown
    assert 1 not in shown
    assert 90 in shown
    assert MAX_PICTURES - 1 <= len(shown) <= MAX_PICTURES + len(MISSED)


@pytest.mark.parametrize("count", [0, 1, 2, 39, 40, 41, 1000])
def test_pictures_are_chosen_evenly(count):
    frames = list(range(5, 5 + count))
    chosen = choose_frames(frames, missed=[7, 4000])
    assert len(chosen) <= MAX_PICTURES + 1
    assert chosen == sorted(set(chosen))
    if count > 3:
        assert {frames[0], frames[-1], 7} <= set(chosen)
    gaps = np.diff(chosen)
    assert count < 3 or gaps.max() <= count / (MAX_PICTURES - 1) + 1


def test_the_same_session_gives_the_same_page(sample_html: str):
    assert render_report(SAMPLE).html == sample_html
