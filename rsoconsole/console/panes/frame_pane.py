"""The pane of a picture with its marks, in characters or the terminal's own graphics."""

from collections.abc import Callable
from typing import Any, ClassVar, Literal, get_args

from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.app import ComposeResult
from textual.events import MouseDown, MouseEvent, MouseUp, Resize
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from rsoconsole.console.drawing.blocks import QUADRANTS, BlockSet, RunKey, fit_to_cells, row_runs
from rsoconsole.console.drawing.plain import NIGHT
from rsoconsole.console.picture.chart import chart_characters, chart_legend
from rsoconsole.console.picture.marks import Cells, Mark, MarkKind, Window, mark_characters
from rsoconsole.console.picture.picture import (
    GREYS,
    STRETCHES,
    DrawnPicture,
    LightImage,
    Look,
    Picture,
    Stretch,
    draw_closeup,
    draw_empty_field,
    draw_field,
    drawn_brightness,
)
from rsoconsole.console.watches.messages import Pointed
from rsoconsole.console.words.words import join_fitting_parts as fitted_words

TOO_BRIGHT_STEPS = round(0.55 * GREYS)
"""Least grey, in steps, of a background on which signs are written in black."""
KINDS: tuple[MarkKind, ...] = get_args(MarkKind)
Sight = Literal["field", "close-up", "full resolution"]
"""Part of a frame: the whole, the followed streak's surroundings, or those pixel by pixel."""
SIGHTS: tuple[Sight, ...] = ("field", "close-up", "full resolution")
Words = Callable[[Picture | None, Sight, DrawnPicture | None], tuple[list[str], list[str]]]
"""Function that returns a picture's title and caption in parts, the most important first."""


class FramePane(Widget):
    """Pane of a picture with its marks, a title above and a caption below."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        *(f"frame--{kind}" for kind in KINDS),
        "frame--title",
        "frame--caption",
    }
    DEFAULT_CSS = """
    FramePane > .frame--followed { color: #ffd75f; text-style: bold; }
    FramePane > .frame--member { color: #ffd75f; }
    FramePane > .frame--coasted { color: #87d7ff; }
    FramePane > .frame--candidate { color: #ffd75f; }
    FramePane > .frame--rejected { color: #d7a787; }
    FramePane > .frame--operator { color: #87d7ff; text-style: bold; }
    FramePane > .frame--predicted { color: #87d7ff; text-style: bold; }
    FramePane > .frame--now { color: #ff87d7; text-style: bold; }
    FramePane > .frame--now_rejected { color: #ff87d7; }
    FramePane > .frame--box { color: #d7a787; }
    FramePane > .frame--cursor { color: #87ffaf; text-style: bold; }
    FramePane > .frame--star { color: #c8c8d0; }
    FramePane > .frame--title { text-style: bold; }
    FramePane > .frame--caption { color: $text-muted; }
    """

    def __init__(self, words: Words, *, id: str | None = None) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(id=id)
        self._words = words
        self.picture: Picture | None = None
        """The shown picture; None: there is none."""
        self._subject: object = None
        self._sight: Sight = "field"
        self._look: Look = "chart"
        self._strips: list[Strip] = []
        self._drawn: DrawnPicture | None = None
        self._marks: tuple[Mark, ...] = ()
        self.absent = "no picture yet"
        self._styles_made: dict[RunKey, Style] = {}
        """Styles by their use; made once for each theme."""
        self._pixels: Any = None
        """Widget that draws by the terminal's own graphics; None: characters draw the picture."""

    def compose(self) -> ComposeResult:
        """Make the widget for the terminal's own graphics, where the terminal has them."""
        graphics = getattr(self.app, "graphics", None)
        if graphics is not None:
            from rsoconsole.console.picture.graphics import image_widget

            self._pixels = image_widget(graphics)
            self._pixels.styles.position = "absolute"
            self._pixels.styles.offset = (0, 1)
            yield self._pixels

    hides_signs = False

    @property
    def drawing(self) -> DrawnPicture | None:
        """The picture as drawn into cells; None while nothing is drawn."""
        if not self._strips:
            self._strips = self._make_strips()
        return self._drawn

    @property
    def blocks(self) -> BlockSet:
        """The block characters that draw pictures."""
        blocks: BlockSet = getattr(self.app, "blocks", QUADRANTS)
        return blocks

    def show(
        self,
        picture: Picture | None,
        sight: Sight,
        look: Look,
        subject: object,
        marks: tuple[Mark, ...] = (),
    ) -> None:
        """Show a picture; it is drawn again only where an argument differs from before.

        ``sight``: part of the frame to show.
        ``look``: whether the field is drawn as a chart, else how light becomes grey.
        ``subject``: any value; where it differs from before, the picture is drawn again.
        ``marks``: further marks, written over the picture's own.
        """
        same = (self.picture, self._sight, self._look, self._subject, self._marks)
        if self._strips and same == (picture, sight, look, subject, marks):
            return
        self.picture, self._sight, self._look, self._subject = picture, sight, look, subject
        self._marks = marks
        self._redraw()

    @property
    def is_chart(self) -> bool:
        """True where the field is drawn as a chart."""
        has_chart = self.picture is not None and self.picture.has_chart
        return has_chart and self._sight == "field" and self._look == "chart"

    @property
    def _stretch(self) -> Stretch:
        return STRETCHES[0] if self._look == "chart" else self._look

    def on_mouse_down(self, event: MouseDown) -> None:
        """Post the pixel of the frame at which the mouse was pressed."""
        self.capture_mouse()
        self._point(event, is_release=False)

    def on_mouse_up(self, event: MouseUp) -> None:
        """Post the pixel of the frame at which the mouse was released."""
        self.release_mouse()
        self._point(event, is_release=True)

    def _point(self, event: MouseEvent, *, is_release: bool) -> None:
        drawing = self.drawing
        at = event.get_content_offset(self)
        if drawing is None or at is None:
            return
        window = drawing.window
        column, row = at.x, at.y - 1
        if not window.has(column, row):
            return
        x_px = window.x0_px + (column + 0.5) * window.width_px / window.columns
        y_px = window.y0_px + (row + 0.5) * window.height_px / window.rows
        self.post_message(Pointed(x_px, y_px, drawing.px_per_square, is_release=is_release))

    def on_resize(self, _event: Resize) -> None:
        """Draw the picture for another size."""
        self._redraw()

    def notify_style_update(self) -> None:
        """Draw the picture again in the colours of the new theme."""
        super().notify_style_update()
        self._strips = []
        self._styles_made.clear()
        if self._pixels is not None:
            self._paint()

    def render_line(self, y: int) -> Strip:
        """Return row ``y`` of the pane; the rows are made when the picture changes."""
        if not self._strips:
            self._strips = self._make_strips()
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width)

    def _redraw(self) -> None:
        before, self._strips = self._strips, []
        if self._pixels is not None:
            self._paint()
        if self._pixels is not None or not before or len(before) != self.size.height:
            self.refresh()
            return
        self._strips = self._make_strips()
        width, rows = self.size.width, enumerate(self._strips)
        changed = [Region(0, y, width, 1) for y, now in rows if before[y : y + 1] != [now]]
        if changed:
            self.refresh(*changed)

    def _paint(self) -> None:
        """Paint the picture by the terminal's own graphics."""
        from rsoconsole.console.picture.graphics import cell_size_px, paint_picture

        drawing = self.drawing
        self._pixels.display = drawing is not None and not self.is_chart
        if drawing is None or self.is_chart:
            return
        window, cell = drawing.window, cell_size_px()
        self._pixels.styles.width, self._pixels.styles.height = window.columns, window.rows
        self._pixels.image = paint_picture(
            self._light(drawing, cell),
            window,
            self._shown_marks(),
            {name: self._ink(name) for name in KINDS},
            cell=cell,
            is_red=self.app.theme == NIGHT,
        )

    def _light(self, drawing: DrawnPicture, _cell_px: tuple[int, int]) -> LightImage:
        """Return the brightness of what is drawn, 0 to 1, at its own resolution."""
        assert self.picture is not None
        return drawn_brightness(
            self.picture, drawing, self._stretch, is_field=self._sight == "field"
        )

    def _shown_marks(self) -> tuple[Mark, ...]:
        """Return the marks to draw; rejected candidates have none in the whole field."""
        own = () if self.picture is None or self.hides_signs else self.picture.marks
        marks = (*own, *self._marks)
        return tuple(m for m in marks if m.kind != "rejected" or self._sight != "field")

    def _absent(self) -> str:
        """Return the text for where no picture is drawn."""
        return self.absent if self.picture is None else "nothing to look at closely"

    def _ink(self, kind: str) -> tuple[int, int, int]:
        """Return the colour of a kind of mark: the brighter one of its style."""
        styles = self.get_component_styles(f"frame--{kind}")
        colour = max(styles.color, styles.background, key=lambda c: c.brightness)
        return colour.rgb

    def _make_strips(self) -> list[Strip]:
        width, height = self.size
        rows = max(height - 2, 0)
        drawing = self._drawn = self._drawing(width, rows)
        title, caption = self._words(self.picture, self._sight, drawing)
        return [
            self._text(
                f"─ {fitted_words(title, width - 4)} ".ljust(width, "─")[:width], "frame--title"
            ),
            *self._picture_strips(drawing, width, rows),
            self._text(
                f" {fitted_words(caption, width - 1, ' ')}".ljust(width)[:width], "frame--caption"
            ),
        ]

    def _drawing(self, width: int, rows: int) -> DrawnPicture | None:
        picture = self.picture
        if not width or not rows or picture is None:
            return None
        if self.is_chart:
            return draw_empty_field(picture, width, rows, self.blocks)
        if self._sight == "field":
            return draw_field(picture, self._stretch, width, rows, self.blocks)
        return draw_closeup(
            picture,
            self._stretch,
            width,
            rows,
            is_native=self._sight == "full resolution",
            blocks=self.blocks,
        )

    def _picture_strips(self, drawing: DrawnPicture | None, width: int, rows: int) -> list[Strip]:
        if not width or not rows:
            return []
        if drawing is None:
            words = self._absent()
            return [
                self._text(
                    (words if row == rows // 2 else "").center(width)[:width], "frame--caption"
                )
                for row in range(rows)
            ]
        window = drawing.window
        style = self.rich_style
        blank = Strip.blank(width, style)
        if self._pixels is not None and not self.is_chart:
            return [blank] * rows
        marks = self._characters(window)
        cells = fit_to_cells(drawing.greys, drawing.blocks)
        legend = self._legend(window, width)
        return [
            Strip.join(
                (
                    self._row(row_runs(cells, drawing.blocks, marks, row)),
                    self._text(legend[row] if row < len(legend) else "", "frame--caption"),
                )
            ).adjust_cell_length(width, style)
            for row in range(window.rows)
        ] + [blank] * (rows - window.rows)

    def _legend(self, window: Window, width: int) -> list[str]:
        """Return the lines beside the picture; empty where it is no chart or fills the pane."""
        if self.picture is None or not self.is_chart:
            return []
        return chart_legend(self.picture, window, width - window.columns)

    def _characters(self, window: Window) -> Cells:
        """Return what is written over the picture."""
        marks = self._shown_marks()
        if self.is_chart:
            assert self.picture is not None
            return chart_characters(self.picture, marks, window)
        return mark_characters(marks, window, has_rejected=True)

    def _row(self, parts: list[tuple[str, RunKey]]) -> Strip:
        return Strip([Segment(text, self._style(key)) for text, key in parts])

    def _style(self, key: RunKey) -> Style:
        style = self._styles_made.get(key)
        if style is None:
            style = self._styles_made[key] = self._made_style(key)
        return style

    def _made_style(self, key: RunKey) -> Style:
        front, back = key
        behind = self._colour(back * 255 / (GREYS - 1))
        if isinstance(front, str):
            style = self.get_component_rich_style(f"frame--{front}")
            if back >= TOO_BRIGHT_STEPS:
                style += Style(color="black")
            return style + Style(bgcolor=behind)
        return Style(color=self._colour(front * 255 / (GREYS - 1)), bgcolor=behind)

    def _colour(self, grey: float) -> Color:
        """Return a grey; in the night theme a red, for eyes that are used to the dark."""
        if self.app.theme == NIGHT:
            return Color.from_rgb(round(0.75 * grey), round(0.12 * grey), round(0.06 * grey))
        return Color.from_rgb(round(grey), round(grey), round(grey))

    def _text(self, text: str, name: str) -> Strip:
        return Strip([Segment(text, self.get_component_rich_style(name))])
