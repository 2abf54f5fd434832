"""The two picture panes, and the keys that zoom and stretch them."""

import math

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.panes.panes import SIGHTS, FramePane, Sight
from rsoconsole.console.picture.picture import STRETCHES, DrawnPicture, Picture, cells_for_aspect
from rsoconsole.console.words import words

SEEN_COLUMNS = 3.0
"""Length in columns of the terminal below which a streak looks like a star in the field."""


class PictureActions(OperatorScreen):
    """Draws a frame in the two picture panes, with the chosen view and stretch."""

    _sight: int | None = None
    """Index in SIGHTS of the view chosen by key; None: the view is chosen by the streak's size."""
    _stretch = 0

    def _picture_panes(self) -> tuple[FramePane, FramePane]:
        """Return the large picture pane and the small one."""
        return self.query_one("#frame", FramePane), self.query_one("#closeup", FramePane)

    def show_picture(self) -> None:
        """Draw the chosen view in the large pane, and the other one in the small pane."""
        large, stretch = SIGHTS[self._sight_now], STRETCHES[self._stretch]
        small: Sight = "close-up" if large == "field" else "field"
        subject, marks = (self.night.frame, stretch, self.hides_signs), self.unfinished_mark_signs()
        for pane, sight in zip(self._picture_panes(), (large, small), strict=True):
            pane.hides_signs = self.hides_signs
            pane.show(self.picture, sight, stretch, subject, marks)

    @property
    def _sight_now(self) -> int:
        """Index in SIGHTS of the view in the large pane."""
        if self._sight is not None:
            return self._sight
        return SIGHTS.index("close-up") if self._is_streak_too_small() else 0

    def _is_streak_too_small(self) -> bool:
        """True where the only visible picture pane would show the streak as a dot."""
        picture, (pane, closeup) = self.picture, self._picture_panes()
        has_both = closeup.display or not pane.display
        if picture is None or picture.closeup is None or has_both:
            return False
        detail = picture.detail
        if detail.accepted_measurement is None and detail.predicted is None:
            return False
        streak = next((mark for mark in picture.marks if mark.kind == "followed"), None)
        if streak is None or streak.ends_px is None or detail.detections is None:
            return True
        columns, _ = cells_for_aspect(picture.aspect, pane.size.width, max(pane.size.height - 2, 1))
        return math.dist(*streak.ends_px) / detail.detections.width_px * columns < SEEN_COLUMNS

    def picture_words(
        self, picture: Picture | None, sight: Sight, drawing: DrawnPicture | None
    ) -> tuple[list[str], list[str]]:
        """Return a picture's title and caption, each in parts with the most important one first."""
        stretch = STRETCHES[self._stretch]
        if sight == "field":
            is_reading = words.is_past_unread(self.night, self.engine)
            title = words.frame_title(self.night, picture, is_reading=is_reading)
            caption = words.frame_caption(picture)
        else:
            title = words.closeup_title(picture, drawing)
            if picture is not None and drawing is not None and self._sight_now:
                # In the large pane, where the frame's own title stands as a rule.
                title = [*words.frame_title(self.night, picture), "close-up", *title[1:]]
            columns = drawing.window.columns - 1 if drawing is not None else words.BADGE_COLUMNS
            caption = words.closeup_caption(picture, columns)
        return title if stretch == "streaks" else [*title, stretch], caption

    def action_zoom(self) -> None:
        """Show the next view: the whole field, the close-up, the close-up pixel by pixel."""
        self._sight = (self._sight_now + 1) % len(SIGHTS)
        self.show_picture()
        self.handle_view_change()
        self.say(f"picture: {SIGHTS[self._sight]}")

    def action_stretch(self) -> None:
        """Draw light as grey by the next stretch of ``STRETCHES``."""
        self._stretch = (self._stretch + 1) % len(STRETCHES)
        self.show_picture()
        self.say(f"stretch: {STRETCHES[self._stretch]}")
