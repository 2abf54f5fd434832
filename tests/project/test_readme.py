"""What the front page and the guides tell a reader to type and to configure is there."""

import re
import tomllib
from pathlib import Path

import pytest
from typer.main import get_command

from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.engine import CHECKS

README = Path(__file__).resolve().parents[2] / "README.md"
pytestmark = pytest.mark.skipif(not README.exists(), reason="no checkout: the README is not here")


@pytest.fixture(scope="module")
def readme() -> str:
    pages = [README, *sorted((README.parent / "rsoconsole" / "cli" / "guide").glob("*.md"))]
    return "\n".join(page.read_text(encoding="utf-8") for page in pages)


def verbs() -> set[str]:
    command = get_command(app)
    return set(command.list_commands(command.make_context("rsoconsole", ["x"])))  # type: ignore[attr-defined]


def test_the_configuration_in_the_guide_is_sound(readme: str) -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", readme, re.DOTALL)
    config = Config.model_validate(tomllib.loads(block))
    assert config.limits.past_meridian_deg == 5
    assert config.indi.mount == "EQMod Mount"


def test_every_setting_the_readme_names_exists(readme: str) -> None:
    names = re.findall(r"`([a-z]+)\.([a-z_]+)(?: = [^`]*)?`", readme)
    settings = [
        (section, key) for section, key in names if section in Config.model_fields and key != "log"
    ]
    assert len(settings) > 5
    for section, key in settings:
        assert key in type(getattr(Config(), section)).model_fields, f"{section}.{key}"


def test_every_command_the_readme_names_is_a_verb_and_every_verb_is_named(readme: str) -> None:
    named = set(re.findall(r"[`$] ?rsoconsole\s([a-z][a-z-]*)\b", readme))
    table = readme[readme.index("| command | does |") : readme.index("Every command has")]
    listed = {
        verb
        for row in table.splitlines()[2:]
        if row.startswith("|")
        for verb in re.findall(r"`(?:rsoconsole )?([a-z-]+)", row.split("|")[1])
    }
    subverbs = {"show", "check", "install", "verify", "repair", "archive", "prune", "keep"}
    listed = {verb for verb in listed if not verb.startswith("-")}
    assert named | (listed - subverbs) <= verbs(), sorted((named | listed) - subverbs - verbs())
    assert verbs() <= listed, sorted(verbs() - listed)


def test_the_checklist_in_the_guide_is_the_one_that_is_gone_through(readme: str) -> None:
    table = readme[readme.index("| check | is well when |") : readme.index("You may know better")]
    told = [
        name
        for row in table.splitlines()
        if row.strip().startswith("| `")
        for name in re.findall(r"`([a-z]+)`", row.split("|")[1])
    ]
    assert sorted(told) == sorted(CHECKS)


def test_the_two_blocks_that_a_reader_pastes_come_first_and_are_whole(readme: str) -> None:
    blocks = re.findall(r"```sh\n(.*?)```", readme, re.DOTALL)
    assert len(blocks) == 2
    assert blocks[0].rstrip().endswith("rsoconsole demo")
    assert blocks[1].rstrip().endswith("pytest -n 3 --dist loadfile --no-loadscope-reorder")
