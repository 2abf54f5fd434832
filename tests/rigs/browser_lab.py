"""JupyterLab and a browser for a test: nothing of the user's own, nothing from the network."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import pytest

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
START_S = 60.0
_QUIET = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
    "--no-first-run",
    # Whatever is not this machine is not found.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)


def expect_browser() -> None:
    """Skip where there is no browser, no driver, no JupyterLab."""
    pytest.importorskip("jupyterlab", reason="needs rsoconsole[notebook]: jupyterlab is missing")
    pytest.importorskip("anywidget", reason="needs rsoconsole[notebook]: anywidget is missing")
    pytest.importorskip("selenium", reason="needs selenium to drive a browser")
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("needs Debian's chromium and chromium-driver")


def notebook(*cells: str) -> str:
    """A notebook of code cells as a file holds it."""
    made = [
        {
            "cell_type": "code",
            "id": f"cell-{number}",
            "metadata": {},
            "execution_count": None,
            "outputs": [],
            "source": source,
        }
        for number, source in enumerate(cells)
    ]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return json.dumps(
        {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    )


def environment_of(folder: Path, **more: str) -> dict[str, str]:
    """A home of its own for Jupyter under ``folder``."""
    places = {
        name: str(folder / name.lower())
        for name in (
            "HOME",
            "JUPYTER_CONFIG_DIR",
            "JUPYTER_DATA_DIR",
            "JUPYTER_RUNTIME_DIR",
            "IPYTHONDIR",
        )
    }
    for place in places.values():
        Path(place).mkdir(parents=True, exist_ok=True)
    # Matplotlib's list of fonts takes seconds to make again.
    more.setdefault("MPLCONFIGDIR", matplotlib.get_configdir())
    root = str(Path(__file__).parents[2])
    paths = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, **places, "PYTHONPATH": paths, **more}


@contextlib.contextmanager
def running_lab(
    folder: Path, notebooks: Path, environment: dict[str, str], theme: str = "JupyterLab Light"
) -> Iterator[str]:
    """JupyterLab over a folder of notebooks; gives its address. Kernels end with it."""
    settings = folder / "settings" / "@jupyterlab" / "apputils-extension"
    settings.mkdir(parents=True, exist_ok=True)
    quiet = {"fetchNews": "false", "checkForUpdates": False}
    (settings / "notification.jupyterlab-settings").write_text(json.dumps(quiet))
    (settings / "themes.jupyterlab-settings").write_text(json.dumps({"theme": theme}))
    port = _free_port()
    said = folder / "lab.log"
    with said.open("wb") as log:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root"),
                *(f"--ServerApp.port={port}", "--ServerApp.port_retries=0"),
                *("--ServerApp.ip=127.0.0.1", f"--ServerApp.root_dir={notebooks}"),
                *("--IdentityProvider.token=", "--ServerApp.password="),
                *("--LabApp.extension_manager=readonly", "--LabApp.news_url=None"),
                "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
                f"--LabApp.user_settings_dir={folder / 'settings'}",
                f"--LabApp.workspaces_dir={folder / 'workspaces'}",
            ],
            env=environment,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    address = f"http://127.0.0.1:{port}"
    try:
        _wait_for_server(process, address, said)
        yield address
    finally:
        _end(process)


def _wait_for_server(process: "subprocess.Popen[bytes]", address: str, said: Path) -> None:
    ends_s = time.monotonic() + START_S
    while time.monotonic() < ends_s and process.poll() is None:
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{address}/api", timeout=2):
            return
        time.sleep(0.1)
    raise AssertionError(f"JupyterLab did not start: {said.read_text()[-2000:]}")


def _end(process: "subprocess.Popen[bytes]") -> None:
    """The server and the kernels that it started: they are of its own session."""
    process.terminate()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(10.0)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def open_browser(folder: Path, size: tuple[int, int] = (1300, 1500)) -> Iterator[Any]:
    """A headless Chromium of its own, driven by selenium."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for argument in (*_QUIET, f"--user-data-dir={folder / 'chromium'}"):
        options.add_argument(argument)
    options.add_argument(f"--window-size={size[0]},{size[1]}")
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    try:
        yield driver
    finally:
        driver.quit()


class Page:
    """A notebook in JupyterLab, as somebody uses it."""

    def __init__(self, driver: Any, address: str, name: str) -> None:
        self.driver = driver
        driver.get(f"{address}/doc/tree/{name}")
        self.wait(lambda: self.all(".jp-Notebook .jp-CodeCell .cm-content"), "the notebook")
        self.wait(self.is_kernel_ready, "its kernel")

    def is_kernel_ready(self) -> bool:
        """Whether the kernel's sign says that it waits."""
        signs = self.all(".jp-Notebook-ExecutionIndicator")
        return bool(signs) and signs[0].get_attribute("data-status") == "idle"

    def all(self, selector: str) -> list[Any]:
        """Everything on the page that a CSS selector names."""
        from selenium.webdriver.common.by import By

        return list(self.driver.find_elements(By.CSS_SELECTOR, selector))

    def text(self, selector: str) -> str:
        """The words of the first such thing; empty where there is none."""
        found = self.all(selector)
        return str(found[0].get_attribute("textContent")) if found else ""

    def run_cell(self, number: int, *, again: bool = False) -> None:
        """Click into a cell and press Shift+Enter; it is begun when this returns."""
        from selenium.webdriver import ActionChains, Keys

        def prompt() -> str:
            return str(self.all(".jp-CodeCell .jp-InputPrompt")[number].text).strip()

        before = prompt() if again else "[ ]:"

        def is_begun() -> bool:
            if prompt() not in {before, ""}:
                return True
            cell = self.all(".jp-Notebook .jp-CodeCell .jp-InputArea-editor")[number]
            self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", cell)
            cell.click()
            actions = ActionChains(self.driver)
            actions.key_down(Keys.SHIFT).send_keys(Keys.ENTER).key_up(Keys.SHIFT).perform()
            time.sleep(0.3)
            return False

        self.wait(is_begun, f"cell {number}")

    def wait(self, condition: Any, what: str, timeout_s: float = 30.0) -> Any:
        """Wait until something is true, and return it."""
        from selenium.common.exceptions import WebDriverException

        ends_s = time.monotonic() + timeout_s
        while True:
            with contextlib.suppress(WebDriverException):
                for answer in self.all(".jp-Dialog .jp-mod-accept"):
                    answer.click()  # which kernel, when the first cell is run
                found = condition()
                if found:
                    return found
            if time.monotonic() > ends_s:
                shown = self.all(".rso-panel, .jp-OutputArea-output")
                text = "\n".join(each.text for each in shown)[-3000:]
                raise AssertionError(f"in {timeout_s:g} s no sign of: {what}; on the page:\n{text}")
            time.sleep(0.05)
