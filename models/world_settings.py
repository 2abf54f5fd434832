"""Write the tables of the simulated world's settings into the simulator's README.

``python -m models.world_settings``
"""

from pathlib import Path

from rsoconsole.config import allowed_words
from rsoconsole.simulator import (
    LAWS,
    SettingDistribution,
    World,
    settings_of_worlds,
    unit_of,
    value_to_toml,
)

README = Path(__file__).parents[1] / "rsoconsole" / "simulator" / "README.md"
BEGIN = "<!-- settings: written by python -m models.world_settings -->"
END = "<!-- end of settings -->"


def settings_table() -> str:
    """The settings of worlds in Markdown, one table per section."""
    laws = {law.name: words_of(law) for law in LAWS}
    lines: list[str] = []
    section_before = ""
    for name, setting in settings_of_worlds().items():
        section, _, key = name.partition(".")
        if section != section_before:
            words = (World.model_fields[section].annotation.__doc__ or "").strip()
            lines += ["", f"**`[{section}]`** {words}", ""]
            lines += ["| setting | unit | default | allowed | meaning | random |", "|---" * 6 + "|"]
            section_before = section
        default = setting.json_schema_extra["own"]
        if setting.default is not None:
            default = value_to_toml(setting.default)
        cells = (f"`{key}`", unit_of(setting) or "-", default, allowed_words(setting) or "-")
        law = laws.get(name, "-")
        lines.append(f"| {' | '.join(cells)} | {setting.description} | {law} |")
    return "\n".join(lines[1:]) + "\n"


def words_of(law: SettingDistribution) -> str:
    """A distribution in words for the documentation."""
    values = f"{law.low:g}"
    if law.high != law.low:
        values = f"{law.low:g} to {law.high:g}"
        values += ", log-uniform" if law.kind == "log-uniform" else ""
    return values if law.share == 1.0 else f"in {law.share:.0%} of worlds {values}"


def with_table(readme: str) -> str:
    """The README's text with its tables replaced by ``settings_table``."""
    head, _, rest = readme.partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}\n\n{settings_table()}\n{END}{tail}"


if __name__ == "__main__":
    README.write_text(with_table(README.read_text(encoding="utf-8")), encoding="utf-8")
