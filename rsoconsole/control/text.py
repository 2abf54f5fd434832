"""Text that others wrote, made fit for a terminal."""


def printable(text: str) -> str:
    """The same without what would be a command to a terminal, by any author."""
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)
