"""The picture of a frame at full resolution, in characters or the terminal's own graphics."""

from rsoconsole.console.frame._sheet import FrameScreenState, readout_parts, title_parts
from rsoconsole.console.frame._sheet_marks import marks_beyond_streak_ends, reprocessed_frame_marks
from rsoconsole.console.panes.frame_pane import SIGHTS, FramePane, Sight
from rsoconsole.console.picture.marks import Mark
from rsoconsole.console.picture.picture import (
    STRETCHES,
    DrawnPicture,
    LightImage,
    Picture,
    greys,
)

MAX_FINER = 4
"""Most pixels of the picture along a square in graphics: more cost time and show nothing."""


class SheetPane(FramePane):
    """Draws a frame's view; until the pixels are read, the session's small picture."""

    def __init__(self, sheet: FrameScreenState, *, id: str | None = None) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(self._said, id=id)
        self._sheet = sheet
        self._is_sight_chosen = False

    def redraw(self) -> None:
        """Draw the frame again after its state has changed."""
        sheet = self._sheet
        self._look = sheet.stretch
        if sheet.pixels is None and sheet.opened is not None:
            preview = self.picture = sheet.opened.preview
            self._look = "chart" if sheet.stretch == STRETCHES[0] else sheet.stretch
            if not self._is_sight_chosen and preview is not None and preview.closeup is not None:
                self._sight = "close-up"
        self._redraw()

    def show_next_view(self) -> None:
        """Show the next view of the session's small pictures."""
        self._is_sight_chosen = True
        self._sight = SIGHTS[(SIGHTS.index(self._sight) + 1) % len(SIGHTS)]
        self._redraw()

    @property
    def room(self) -> tuple[int, int]:
        """Columns and rows for the picture itself, without title and caption."""
        return max(self.size.width, 1), max(self.size.height - 2, 1)

    def _said(
        self, _picture: Picture | None, _sight: Sight, _drawing: DrawnPicture | None
    ) -> tuple[list[str], list[str]]:
        return title_parts(self._sheet), readout_parts(self._sheet)

    def _drawing(self, width: int, rows: int) -> DrawnPicture | None:
        view = self._sheet.view
        if self._sheet.pixels is None or view is None:
            return super()._drawing(width, rows)
        if not width or not rows:
            return None
        return DrawnPicture(
            greys=greys(self._shares_of(self.blocks.across, self.blocks.down)),
            blocks=self.blocks,
            window=view.window,
            px_per_square=view.px_per_square,
        )

    def _light(self, drawing: DrawnPicture, cell_px: tuple[int, int]) -> LightImage:
        if self._sheet.pixels is None:
            return super()._light(drawing, cell_px)
        finer = max(min(int(drawing.px_per_square), cell_px[0], MAX_FINER), 1)
        return self._shares_of(finer, 2 * finer)

    def _shares_of(self, across: int, down: int) -> LightImage:
        """Return the brightness of parts of the cells; ``across``, ``down``: parts of a cell."""
        from rsoconsole.console.picture.sheet_pixels import map_brightness

        sheet = self._sheet
        assert sheet.pixels is not None
        assert sheet.view is not None
        if sheet.map is not None:
            return map_brightness(sheet.map, sheet.view.window, across, down)
        return sheet.pixels.shares(sheet.view.window, sheet.stretch, across, down)

    def _shown_marks(self) -> tuple[Mark, ...]:
        sheet = self._sheet
        if sheet.opened is None:
            return ()
        candidates = sheet.candidates if sheet.done is not None else ()
        marks = reprocessed_frame_marks(sheet.opened.detail, candidates, sheet.chosen)
        if not sheet.are_marks_shown:
            is_faint = sheet.is_marking and sheet.view is not None and sheet.pixels is not None
            marks = (
                marks_beyond_streak_ends(marks, sheet.view.px_per_square)
                if is_faint and sheet.view
                else ()
            )
        if sheet.view is None or sheet.pixels is None:
            return marks
        if sheet.first_px is not None:
            x_px, y_px = sheet.first_px
            marks = (*marks, Mark(x_px=x_px, y_px=y_px, kind="cursor", label="1"))
        return (*marks, Mark(x_px=sheet.view.x_px, y_px=sheet.view.y_px, kind="cursor"))

    def _absent(self) -> str:
        return "reading …" if self._sheet.opened is None else "no picture of it was kept"
