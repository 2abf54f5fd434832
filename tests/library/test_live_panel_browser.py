"""The live panel as it is used: JupyterLab, a browser, a whole engine, a simulated observatory.

The page is opened once; every test brings engine and mount to where it begins, the last one ends
the engine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from rsoconsole.records import ParameterChange
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.rigs.browser_lab import (
    Page,
    environment_of,
    expect_browser,
    notebook,
    open_browser,
    running_lab,
)
from tests.rigs.whole_engine import WholeEngine, is_slewing, mount_by_itself, wait_for, whole_engine

pytestmark = pytest.mark.nightly("drives a browser")
EXPOSURE = {"exposure_s": 2.0, "cadence_s": 4.0}
DARK = {"twilight_deg": -80.0}
"""No night is so dark: the check of the Sun fails."""
SPEED = 2.0
FAR = {"ra_icrs_deg": 205.0, "dec_icrs_deg": 10.0}
"""Some ten seconds of slewing away."""
NEAR_TEXT, LOW_TEXT = "238.5 -5.5", "60 -5"
BUSY_S = 20
FIRST_TRY_S = 15.0
FIRST, PANEL, BUSY = 0, 1, 2


@dataclass
class NotebookUser:
    """Somebody at a notebook, and what is at the other end."""

    page: Page
    engine: WholeEngine
    sky: Observatory

    def button(self, words: str) -> Any:
        """The button of that name that can be pressed; None where there is none."""
        found = [each for each in self.page.all(".rso-panel button") if each.text == words]
        return found[0] if found and found[0].is_enabled() else None

    def press(self, words: str) -> None:
        """Press it as soon as it can be."""
        self.page.wait(lambda: self.button(words), f"a button {words!r}").click()

    def armed(self) -> None:
        """Autonomy has the mount."""
        if self.engine.status()["holder"] != "autonomy":
            lifted = ["sun", "index", "pointing", "disk", "clock"]
            assert self.engine.send("arm", override=lifted).ok
        wait_for(lambda: self.engine.status()["holder"] == "autonomy", "an armed engine")
        self.page.wait(lambda: self.button("Disarm"), "an armed engine on the page")

    def moving(self) -> None:
        """The mount is on a long way."""
        assert self.engine.send("goto", **FAR).ok
        wait_for(lambda: is_slewing(mount_by_itself(self.sky)), "a mount that moves")

    def fill(self, selector: str, words: str) -> None:
        """Type over what is in a field; it keeps the focus, so that nothing is put back."""
        from selenium.webdriver import Keys

        (field,) = self.page.all(selector)
        field.click()
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys(words)


def show_panel(page: Page) -> None:
    """Run the panel's cell; once more where a JupyterLab that has just started missed its widget.

    It then stays at "Loading widget..." whatever widget it is; a person runs the cell again.
    """
    page.run_cell(PANEL)
    try:
        page.wait(lambda: page.all(".rso-panel"), "the panel", FIRST_TRY_S)
    except AssertionError:
        page.run_cell(PANEL, again=True)
    page.wait(lambda: "has the mount" in page.text(".rso-holder"), "the engine on the panel")


@pytest.fixture(scope="module")
def user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NotebookUser]:
    expect_browser()
    folder = tmp_path_factory.mktemp("lab")
    notebooks = folder / "notebooks"
    notebooks.mkdir()
    cells = (
        "1",
        "import rsoconsole\npanel = rsoconsole.live_panel()\npanel",
        f"import time\ntime.sleep({BUSY_S})",
    )
    (notebooks / "panel.ipynb").write_text(notebook(*cells), encoding="utf-8")
    stage = "tests.rigs.stub_stage:open_plain"
    with (
        start_observatory("intelsat-14", 1, SPEED, stage=stage) as sky,
        whole_engine(folder / "engine", sky, exposure=EXPOSURE, limits=DARK) as engine,
    ):
        engine.start()
        own = {name: engine.environment[name] for name in ("XDG_RUNTIME_DIR", "RSOCONSOLE_CONFIG")}
        environment = environment_of(folder / "jupyter", **own)
        with (
            running_lab(folder / "jupyter", notebooks, environment) as address,
            open_browser(folder / "jupyter") as driver,
        ):
            page = Page(driver, address, "panel.ipynb")
            page.run_cell(FIRST)
            show_panel(page)
            yield NotebookUser(page, engine, sky)


def test_the_page_shows_the_engine_its_picture_and_its_record(
    user: NotebookUser,
) -> None:
    user.armed()
    page = user.page
    page.wait(lambda: page.text(".rso-state") == user.engine.status()["state"], "its state")
    page.wait(lambda: page.text(".rso-holder") == "autonomy has the mount", "who has the mount")
    page.wait(lambda: page.all(".rso-image[src^=blob]"), "a picture")
    image = page.all(".rso-image")[0]
    page.wait(lambda: image.get_property("naturalWidth") == 256, "a picture that can be seen")
    assert len(page.all(".rso-plot svg")) == 4
    assert "armed by configuration" in page.text(".rso-log")
    assert "frame" in page.text("figcaption")


def test_stop_acts_at_once_though_a_cell_runs(user: NotebookUser) -> None:
    user.page.run_cell(BUSY)
    user.moving()
    user.press("STOP")
    user.page.wait(lambda: "ABORT answered" in user.page.text(".rso-banner"), "its answer", 5.0)
    assert not is_slewing(mount_by_itself(user.sky))
    wait_for(lambda: user.engine.status()["holder"] == "nobody", "a disarmed engine", 3.0)
    busy = user.page.all(".jp-CodeCell .jp-InputPrompt")[BUSY]
    assert busy.text.strip() == "[*]:"
    user.page.wait(lambda: "measured in" in user.page.text(".rso-banner"), "how it moves", 20.0)


def test_arming_asks_which_failed_checks_are_overridden(user: NotebookUser) -> None:
    user.engine.send("disarm")
    user.page.wait(lambda: user.button("Arm"), "a disarmed engine on the page")
    user.press("Arm")
    user.page.wait(lambda: user.button("Arm, overriding the ticked"), "the checklist")
    failed = user.page.all(".rso-dialog input")
    names = {each.get_attribute("value") for each in failed}
    assert names == {"sun", "pointing"}
    user.press("Stay disarmed")
    user.page.wait(lambda: not user.button("Stay disarmed"), "the checklist put away")
    assert user.engine.status()["holder"] == "nobody"
    user.press("Arm")
    user.page.wait(lambda: user.button("Arm, overriding the ticked"), "the checklist again")
    for each in user.page.all(".rso-dialog input"):
        each.click()
    user.press("Arm, overriding the ticked")
    wait_for(lambda: user.engine.status()["holder"] == "autonomy", "an armed engine")
    assert set(user.engine.status()["lifted"]) >= names
    user.page.wait(lambda: "overridden" in user.page.text(".rso-alerts"), "what was overridden")


def test_hold_and_resume(user: NotebookUser) -> None:
    user.armed()
    user.press("Hold")
    wait_for(lambda: user.engine.status()["is_held"], "a held engine")
    user.page.wait(lambda: "HELD" in user.page.text(".rso-state"), "the hold on the page")
    user.press("Resume")
    wait_for(lambda: not user.engine.status()["is_held"], "an engine that goes on")


def test_go_to_shows_the_way_first_and_is_refused_below_the_horizon(
    user: NotebookUser,
) -> None:
    user.armed()
    user.fill(".rso-where", LOW_TEXT)
    user.page.wait(lambda: "REFUSED" in user.page.text(".rso-way"), "a refusal")
    assert user.button("Go there") is None
    user.fill(".rso-where", NEAR_TEXT)
    user.page.wait(lambda: "way " in user.page.text(".rso-way"), "the way")
    assert user.engine.status()["holder"] == "autonomy"
    user.press("Go there")
    wait_for(lambda: user.engine.status()["holder"] == "operator", "a move by hand")
    ra_deg, dec_deg = (float(word) for word in NEAR_TEXT.split())

    def is_there() -> bool:
        told = user.engine.status()
        near = abs(told["mount_ra"] - ra_deg) < 0.1 and abs(told["mount_dec"] - dec_deg) < 0.1
        return near and not told["is_slewing"]

    wait_for(is_there, "a telescope that looks there")
    user.press("Resume")
    wait_for(lambda: user.engine.status()["holder"] == "autonomy", "autonomy again")


def test_tuning_shows_its_effect_and_applies(user: NotebookUser) -> None:
    user.armed()
    user.page.all(".rso-tune summary")[0].click()
    user.fill('.rso-tuned [name="filter.q_multiplier"]', "4")
    user.page.wait(lambda: "if tried" in user.page.text(".rso-effect"), "the effect")
    user.press("Apply")

    def changes() -> list[ParameterChange]:
        found = user.engine.reader.records(kinds=(ParameterChange,))
        return [r for _, _, r in found if r.name == "filter.q_multiplier"]

    (change,) = wait_for(changes, "the change on record")
    assert change.after == 4.0
    assert change.by.startswith("console ")
    field = user.page.all('.rso-tuned [name="filter.q_multiplier"]')[0]
    user.page.wait(lambda: "rso-tried" not in field.get_attribute("class"), "the value in force")


def test_stop_goes_past_an_engine_that_is_gone(user: NotebookUser) -> None:
    user.moving()
    user.engine.kill()
    user.page.wait(lambda: user.page.text(".rso-state") == "ENGINE GONE", "the engine's end")
    assert user.button("Hold") is None
    user.press("STOP")
    user.page.wait(lambda: "past the engine" in user.page.text(".rso-banner"), "its end", 5.0)
    wait_for(lambda: not is_slewing(mount_by_itself(user.sky)), "a mount that stands", 3.0)
