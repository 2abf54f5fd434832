"""No command is on the README or on the manual page that no test runs as it is printed."""

import pytest

from tests.cli import test_commands_about_the_house as about_the_house
from tests.cli import test_commands_at_the_telescope as at_the_telescope
from tests.cli import test_commands_on_records as on_records
from tests.cli.test_manual_page import commands as of_the_manual_page
from tests.cli.test_readme_commands import NIGHT, row_of
from tests.cli.test_readme_commands import commands as of_the_readme

pytestmark = pytest.mark.skipif(not NIGHT.exists(), reason="no checkout: the README is not here")
IN_COMPANY = {*at_the_telescope.BY_ORDERS, *at_the_telescope.ARMED}
"""Run by one test after another in one house."""
ALONE = [each.RECIPES for each in (about_the_house, at_the_telescope, on_records)]


def test_each_is_run_and_nothing_that_is_on_no_page() -> None:
    # Beside them both pages have ``rsoconsole --install-completion``: ``test_completion.py``.
    on_pages = {*of_the_readme(), *of_the_manual_page()}
    run = IN_COMPANY.union(*ALONE)
    assert on_pages - run == set(), "write how it is run: a recipe in one of the three files"
    assert run - on_pages == set(), "these are on no page any more"
    assert len(on_pages) > 90


def test_no_command_is_run_twice() -> None:
    assert len(IN_COMPANY) + sum(map(len, ALONE)) == len(IN_COMPANY.union(*ALONE))


def test_short_commands_of_a_row_are_whole_ones() -> None:
    assert row_of("`rsoconsole config init`, `show`, `check`")[1:] == [
        "rsoconsole config show",
        "rsoconsole config check",
    ]
    assert row_of("`rsoconsole drop TRACK`, `keep TRACK`")[1:] == ["rsoconsole keep TRACK"]
