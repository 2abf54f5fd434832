"""The console's colours: dark, deep red for dark-adapted eyes, the terminal's own, light."""

from textual.theme import Theme

NIGHT = "night"

THEMES = (
    Theme(
        name="dark",
        primary="#8fa8c8",
        secondary="#7f8fa8",
        success="#6fbf73",
        warning="#e0b050",
        error="#e06058",
        foreground="#d0d0d0",
        background="#101014",
        surface="#1a1a20",
        panel="#24242c",
        dark=True,
    ),
    Theme(
        name="light",
        primary="#2c4a72",
        secondary="#4a6080",
        success="#1f6e2a",
        warning="#8a5a00",
        error="#a81e1e",
        foreground="#1c1c20",
        background="#fafaf6",
        surface="#f0efe8",
        panel="#e2e0d6",
        dark=False,
    ),
    Theme(
        name=NIGHT,
        primary="#8a1a10",
        secondary="#6a140c",
        success="#a02818",
        warning="#b83420",
        error="#d84028",
        foreground="#a02818",
        background="#000000",
        surface="#100302",
        panel="#1a0604",
        dark=True,
        variables={
            "text-muted": "#6a180e",
            "text-success": "#b03020",
            "text-warning": "#c83c28",
            "text-error": "#e04830",
            "text": "#b03020",
        },
    ),
)
COLOURS = {
    "dark": "dark",
    "night": "night: deep red only",
    "ansi-dark": "the terminal's own sixteen, dark",
    "ansi-light": "the terminal's own sixteen, light",
    "light": "light",
}
"""Themes that ctrl+t goes through, and what they are called: red comes first, white last."""

NIGHT_CSS = """
ConsoleApp.-theme-night FramePane > .frame--followed { color: #d84028; }
ConsoleApp.-theme-night FramePane > .frame--member { color: #d84028; }
ConsoleApp.-theme-night FramePane > .frame--candidate { color: #d84028; }
ConsoleApp.-theme-night FramePane > .frame--rejected { color: #8a1a10; }
ConsoleApp.-theme-night FramePane > .frame--operator { color: #b03020; }
ConsoleApp.-theme-night FramePane > .frame--predicted { color: #c83c28; }
ConsoleApp.-theme-night FramePane > .frame--coasted { color: #b03020; }
ConsoleApp.-theme-night FramePane > .frame--now { color: #c83c28; }
ConsoleApp.-theme-night FramePane > .frame--now_rejected { color: #b83420; }
ConsoleApp.-theme-night FramePane > .frame--box { color: #8a1a10; }
ConsoleApp.-theme-night FramePane > .frame--cursor { color: #e04830; }
"""
"""The picture's marks, which are bright elsewhere."""
