"""The verbs; nothing else. What they do lies on the floors below."""

from rsoconsole.cli.app import main

__all__ = ["main"]
