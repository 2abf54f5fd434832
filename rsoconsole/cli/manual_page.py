"""``python -m rsoconsole.cli.manual_page``: write the manual page that packages bring along."""

from pathlib import Path

from typer.main import get_command

from rsoconsole.cli.app import app
from rsoconsole.cli.words.manual import manual_page

PAGE = Path(__file__).resolve().parent / "guide" / "rsoconsole.1"


def text() -> str:
    """The page of this very program."""
    return manual_page(get_command(app))


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
