"""The table of every setting of a world, as the README beside this file carries it.

``python -m rsoconsole.simulator.nights.world_docs`` writes it there again; a test holds them equal.
"""

from pathlib import Path

from rsoconsole.simulator.nights.world_laws import LAWS
from rsoconsole.simulator.world import World, settings_of_worlds

README = Path(__file__).parents[1] / "README.md"
BEGIN = "<!-- settings: written by python -m rsoconsole.simulator.nights.world_docs -->"
END = "<!-- end of settings -->"


def settings_table() -> str:
    """Markdown: a table for each section."""
    laws = {law.name: law.words for law in LAWS}
    lines: list[str] = []
    section_before = ""
    for setting in settings_of_worlds():
        section, _, key = setting.name.partition(".")
        if section != section_before:
            words = (World.model_fields[section].annotation.__doc__ or "").strip()
            lines += ["", f"**`[{section}]`** {words}", ""]
            lines += ["| setting | unit | default | allowed | meaning | random |", "|---" * 6 + "|"]
            section_before = section
        law = laws.get(setting.name, "-")
        cells = (f"`{key}`", setting.unit or "-", setting.default, setting.limits or "-")
        lines.append(f"| {' | '.join(cells)} | {setting.description} | {law} |")
    return "\n".join(lines[1:]) + "\n"


def with_table(readme: str) -> str:
    """The README with its table as the code has it now."""
    head, _, rest = readme.partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}\n\n{settings_table()}\n{END}{tail}"


if __name__ == "__main__":
    README.write_text(with_table(README.read_text(encoding="utf-8")), encoding="utf-8")
