"""The two picture panes, and the keys that zoom and stretch them."""

import math

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.panes.frame_pane import SIGHTS, Sight
from rsoconsole.console.picture.picture import (
    LOOKS,
    DrawnPicture,
    Look,
    Picture,
    cells_for_aspect,
)
from rsoconsole.console.words import words

SEEN_COLUMNS = 3.0
"""Length in columns of the terminal below which a streak looks like a star in the field."""


class PictureActions(OperatorScreen):
    """Draws a frame in the two picture panes, with the chosen view and look."""

    _sight: int | None = None
    """Index in SIGHTS of the view chosen by key; None: the view is chosen by what is followed."""
    _look: Look = "chart"

    def show_picture(self) -> None:
        """Draw the chosen view in the main pane, and the other one in the pane beside it."""
        main = SIGHTS[self._sight_now]
        beside: Sight = "close-up" if main == "field" else "field"
        # A streak that was missed is on no chart.
        look = "streaks" if self._look == "chart" and self.is_marking else self._look
        subject, marks = (self.night.frame, self.hides_signs), self.unfinished_mark_signs()
        for pane, sight in zip(self.picture_panes(), (main, beside), strict=True):
            pane.hides_signs = self.hides_signs
            pane.show(self.picture, sight, look, subject, marks)

    @property
    def _sight_now(self) -> int:
        """Index in SIGHTS of the view in the main pane."""
        if self._sight is not None:
            return self._sight
        return SIGHTS.index("close-up" if self._has_close_view() else "field")

    def _has_close_view(self) -> bool:
        """True where the close-up is what to look at: during a mark, and for a followed streak.

        Where only one pane is visible, a streak that is long enough is looked at in the field.
        """
        picture, (_, beside) = self.picture, self.picture_panes()
        if picture is None or picture.closeup is None:
            return False
        detail = picture.detail
        if self.is_marking:
            return True
        if detail.accepted_measurement is None and detail.predicted is None:
            return False
        return beside.display or self._is_streak_too_small(picture)

    def _is_streak_too_small(self, picture: Picture) -> bool:
        """True where the main pane would show the streak in the field as a dot."""
        pane, detail = self.picture_panes()[0], picture.detail
        streak = next((mark for mark in picture.marks if mark.kind == "followed"), None)
        if streak is None or streak.ends_px is None or detail.detections is None:
            return True
        columns, _ = cells_for_aspect(picture.aspect, pane.size.width, max(pane.size.height - 2, 1))
        return math.dist(*streak.ends_px) / detail.detections.width_px * columns < SEEN_COLUMNS

    def look_closely(self) -> None:
        """Show the close-up in the main pane, where there is one, instead of a chosen field."""
        self._sight = self._sight or None
        self.show_picture()

    def picture_words(
        self, picture: Picture | None, sight: Sight, drawing: DrawnPicture | None
    ) -> tuple[list[str], list[str]]:
        """Return a picture's title and caption, each in parts with the most important one first."""
        if sight == "field":
            is_reading = words.is_past_unread(self.night, self.engine)
            title = words.frame_title(self.night, picture, is_reading=is_reading)
            if picture is not None and self._sight_now:
                title = ["field"]  # beside the main pane, where the frame's own title stands
            caption = words.frame_caption(picture)
        else:
            title = words.closeup_title(picture, drawing)
            if picture is not None and drawing is not None and self._sight_now:
                # In the main pane, where the frame's own title stands as a rule.
                title = [*words.frame_title(self.night, picture), "close-up", *title[1:]]
            columns = drawing.window.columns - 1 if drawing is not None else words.BADGE_COLUMNS
            caption = words.closeup_caption(picture, columns)
        return title if self._look in {"chart", "streaks"} else [*title, self._look], caption

    def action_zoom(self) -> None:
        """Show the next view: the whole field, the close-up, the close-up pixel by pixel."""
        self._sight = (self._sight_now + 1) % len(SIGHTS)
        self.show_picture()
        self.handle_view_change()
        self.say(f"picture: {SIGHTS[self._sight]}")

    def action_stretch(self) -> None:
        """Draw the field as a chart, where its stars are known, or light by the next stretch."""
        has_chart = self.picture is not None and self.picture.has_chart
        # Without a chart the first stretch stands in for it.
        at = max(LOOKS.index(self._look), 0 if has_chart else 1) + 1
        self._look = LOOKS[at] if at < len(LOOKS) else LOOKS[0 if has_chart else 1]
        self.show_picture()
        self.say("field: chart" if self._look == "chart" else f"stretch: {self._look}")
