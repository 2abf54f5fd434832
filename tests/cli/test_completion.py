"""TAB in bash, zsh and fish: verbs, options, and values that only the program knows."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rsoconsole.cli.words import completion
from rsoconsole.config import Config, every_setting
from tests.nights.samples import SAMPLE
from tests.rigs.in_process import run_here

PROGRAM = Path(sys.executable).with_name("rsoconsole")
pytestmark = pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not installed")
CASES = {
    "demo --scenario int": ["intelsat-14", "intelsat-21"],
    "process --preset t": ["tuned"],
    "export x --format td": ["tdm", "tdm-xml"],
    "set aim.po": ["aim.policy"],
    "set aim.policy ": ["lead", "most", "group"],
    "what-if x --set detector.map": ["detector.map_mode"],
    "arm --override d": ["dome", "disk"],
    "sess": ["sessions"],
    "sessions ver": ["verify"],
    "detect --map": ["--map-mode"],
}

FEW = {case: CASES[case] for case in ("export x --format td", "set aim.policy ", "detect --map")}
"""Which of them the shells are asked: each takes the program's start."""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two nights under session.root, a third and a folder in the working folder."""
    root = tmp_path / "root"
    for place in (root / "night-1", root / "night-2", tmp_path / "here" / "below" / "night-3"):
        shutil.copytree(SAMPLE, place)
    (tmp_path / "here" / "nothing").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("RSOCONSOLE_SESSION__ROOT", str(root))
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    monkeypatch.setenv("PATH", f"{PROGRAM.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    return root


def shell(name: str) -> str:
    """Skips where there is none."""
    program = shutil.which(name)
    if program is None:
        pytest.skip(f"needs {name}")
    return program


def run(words: list[str], script: str = "") -> str:
    done = subprocess.run(
        words, input=script, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


BASH = """
eval "$(rsoconsole --show-completion bash 2>/dev/null)"
while IFS= read -r line; do
    read -ra COMP_WORDS <<< "$line"
    [ "${line: -1}" = " " ] && COMP_WORDS+=("")
    COMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 ))
    _rsoconsole_completion rsoconsole
    (IFS=,; printf '%s\\n' "${COMPREPLY[*]}")
done
"""


def completed(line: str, patch: pytest.MonkeyPatch) -> list[str]:
    """What bash is given for it, asked in the process of the tests."""
    words = line.split() + [""] * line.endswith(" ")
    with patch.context() as of_bash:
        of_bash.setenv("_RSOCONSOLE_COMPLETE", "complete_bash")
        of_bash.setenv("COMP_WORDS", "\n".join(words))
        of_bash.setenv("COMP_CWORD", str(len(words) - 1))
        done = run_here()
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def test_verbs_options_and_values_are_completed(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for case, words in CASES.items():
        assert completed(f"rsoconsole {case}", monkeypatch) == words


@pytest.mark.parametrize(
    "cases",
    [
        pytest.param(FEW, id="few"),
        pytest.param(
            CASES, id="all", marks=pytest.mark.nightly("starts the program for each of them")
        ),
    ],
)
def test_bash_completes_verbs_options_and_values(cases: dict[str, list[str]], home: Path) -> None:
    lines = "".join(f"rsoconsole {case}\n" for case in cases)
    shown = run([shell("bash"), "--norc", "-c", BASH], lines).splitlines()
    assert [line.split(",") for line in shown] == list(cases.values())


def test_fish_completes_the_same_with_what_it_is(home: Path) -> None:
    script = "rsoconsole --show-completion fish | source\n" + "".join(
        f"complete -C 'rsoconsole {case}'; echo ==\n" for case in FEW
    )
    shown = run([shell("fish"), "--no-config", "-c", script])
    found = [
        [line.partition("\t")[0] for line in part.strip().splitlines()]
        for part in shown.split("==\n")[:-1]
    ]
    assert [sorted(each) for each in found] == [sorted(each) for each in FEW.values()]
    assert "Map the network sees" in shown


def test_zsh_is_given_the_same(home: Path) -> None:
    """What its completion function evaluates; zsh itself has no way to show it to a pipe."""
    zsh = shell("zsh")
    script = run(["rsoconsole", "--show-completion", "zsh"])
    run([zsh, "-f", "-c", f"autoload -U compinit && compinit -u -D\n{script}"])
    for case, words in FEW.items():
        done = subprocess.run(
            ["rsoconsole"],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
            env={
                **os.environ,
                "_RSOCONSOLE_COMPLETE": "complete_zsh",
                "_TYPER_COMPLETE_ARGS": f"rsoconsole {case}",
            },
        )
        assert all(f'"{word}"' in done.stdout for word in words), case
        assert done.stderr == ""


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_it_installs_itself(name: str, home: Path) -> None:
    shell(name)
    shown = run(["rsoconsole", "--install-completion", name])
    assert f"{name} completion installed" in shown
    written = [path for path in Path.home().rglob("*rsoconsole*") if path.is_file()]
    assert any("_RSOCONSOLE_COMPLETE" in path.read_text() for path in written)


def test_a_wrong_variable_says_nothing_into_the_line_that_is_typed(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RSOCONSOLE_QUUX", "1")
    monkeypatch.setenv("RSOCONSOLE_SITE__LATITUDE_DEG", "north")
    assert completed("rsoconsole sess", monkeypatch) == ["sessions"]
    assert completed("rsoconsole review ni", monkeypatch) == []


# What each completer finds


def test_sessions_are_those_below_what_is_typed_and_all_of_the_root(home: Path) -> None:
    everywhere = [str(home / "night-1"), str(home / "night-2")]
    assert completion.sessions("") == everywhere
    assert completion.sessions("below/") == ["below/night-3"]
    assert completion.sessions("below/ni") == ["below/night-3"]
    assert completion.sessions("./below/") == ["./below/night-3"]
    assert completion.sessions(f"{home}/night-2") == [everywhere[1]]
    assert completion.sessions("~/here/below/") == ["~/here/below/night-3"]
    # The shell goes on into folders by itself.
    assert completion.sessions("be") == []
    assert completion.sessions("no/such/") == []
    assert completion.sessions("~nosuch/") == []


def test_a_review_takes_names_under_the_root_too(home: Path) -> None:
    assert completion.session_names("ni") == ["night-1", "night-2"]
    assert completion.session_names("below/") == ["below/night-3"]


def test_a_name_that_the_shell_would_split_is_left_out(home: Path) -> None:
    (home / "night-1").rename(home / "a night")
    assert completion.sessions("") == [str(home / "night-2")]


def context(**params: object) -> SimpleNamespace:
    return SimpleNamespace(params=params)


def test_values_of_settings_that_are_a_few_words() -> None:
    assert completion.setting_choices("filter.preset") == ("adaptive", "tuned", "paper")
    assert completion.setting_choices("leap.enabled") == ("true", "false")
    for name in ("site.latitude_deg", "nosuch.setting", "site.nosuch", "", "site"):
        assert completion.setting_choices(name) == ()
    assert completion.setting_values(context(name="detector.map_mode"), "p") == ["paper"]
    assert completion.setting_values(context(), "") == []


def test_names_of_settings_are_all_and_of_a_running_engine_those_that_may_change() -> None:
    every = {name for name, _ in completion.setting_names(context(), "")}
    assert every == {name for name, _, _ in every_setting(Config())}
    tunable = {name for name, _ in completion.tunable_names(context(), "")}
    assert "detector.tau" in tunable
    assert "site.latitude_deg" not in tunable


def test_branches_are_those_of_the_sessions_before(home: Path) -> None:
    (home / "night-1" / "branches" / "calmer").mkdir(parents=True)
    assert completion.branches(context(sessions=[str(home / "night-1")]), "c") == ["calmer"]
    assert completion.branches(context(sessions=["nosuch"]), "") == []
