"""What the package index shows of the README, where links within a checkout lead nowhere.

Run by hatchling when the project is built. Where pyproject.toml says under
``tool.hatch.metadata.hooks.custom`` at which address the files are to be seen (``links``,
``pictures``), links go there; until it does they are text, and pictures are left out.
"""

import re
from pathlib import Path
from typing import Any

try:
    from hatchling.metadata.plugin.interface import MetadataHookInterface
except ImportError:  # a test reads this file without what builds the project
    MetadataHookInterface = object  # type: ignore[assignment,misc]

_PICTURE = re.compile(r"!\[([^\]]*)\]\((?!https?:)([^)\s]+)\)\n*")
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")


def for_package_index(readme: str, *, links: str = "", pictures: str = "") -> str:
    """The README with absolute links. ``links``, ``pictures``: addresses that end in a slash."""

    def picture(found: re.Match[str]) -> str:
        return f"![{found[1]}]({pictures}{found[2]})\n\n" if pictures else ""

    def link(found: re.Match[str]) -> str:
        return f"[{found[1]}]({links}{found[2]})" if links else found[1]

    return _LINK.sub(link, _PICTURE.sub(picture, readme))


class ReadmeHook(MetadataHookInterface):
    """Puts the README into the metadata."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Called by hatchling."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        shown = for_package_index(
            text, links=self.config.get("links", ""), pictures=self.config.get("pictures", "")
        )
        metadata["readme"] = {"content-type": "text/markdown", "text": shown}
