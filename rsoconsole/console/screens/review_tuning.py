"""Tuning in a review: what would have been up to the moment that is shown; nothing is applied."""

from rsoconsole.console.actions import TuneActions
from rsoconsole.console.commands import first_key
from rsoconsole.console.screens.review_seat import ReviewSeat
from rsoconsole.console.tuning import TuneWords


class ReviewTuneActions(TuneActions):
    """Over the last frames before the moment, or over all before it."""

    def __init__(self, seat: ReviewSeat) -> None:
        super().__init__(seat)
        self._review = seat
        self._is_of_all = False

    @property
    def words(self) -> TuneWords:
        """Nothing is applied here."""
        frames = "all frames so far" if self._is_of_all else "{count} frames to here"
        scope = first_key("tune_scope", self._review.keymap)
        which = "the last frames" if self._is_of_all else "all frames"
        return TuneWords(
            frames=frames,
            of_present=self.of_present(),
            keys=f"{scope} {which}  u undo  w save  o load",
        )

    def scope(self) -> tuple[int | None, int | None]:
        """Up to the moment."""
        return self._review.seq, None if self._is_of_all else self.last_frames()

    def action_tune_scope(self) -> None:
        """The last frames, or all."""
        self._is_of_all = not self._is_of_all
        self.show()
        self.compute()
        self._review.say(f"tune: {self.words.frames}")
