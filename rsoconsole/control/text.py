"""Text that others wrote, made fit for a terminal."""


def printable(text: str) -> str:
    """The same without what would be a command to a terminal, by any author."""
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)


def one_line(text: str) -> str:
    """The same on one line: a line break in it could pass for a line of the program's own."""
    return printable(text).replace("\n", " ")
