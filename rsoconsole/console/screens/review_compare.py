"""Two moments: one is kept, the other is where one is; side by side, or in turn."""

from rsoconsole.console.commands import first_key
from rsoconsole.console.screens.compare import Choice, CompareDialog
from rsoconsole.console.screens.review_moves import ReviewMoves
from rsoconsole.console.screens.review_seat import ReviewSeat
from rsoconsole.console.timeline import Moment


class ReviewCompare:
    """Keeps moment A, and shows it beside another one or in turn with it."""

    def __init__(self, review: ReviewSeat, moves: ReviewMoves) -> None:
        self._review, self._moves = review, moves
        self._other_seq: int | None = None
        """B, while A is shown in its place."""
        self._is_asked_early = False
        """Whether to compare as soon as the moment is there that was gone to."""

    def forget(self) -> None:
        """Another session is shown: no moment of it is kept."""
        self._review.kept = self._other_seq = None

    def action_compare(self) -> None:
        """Keep this moment, or show it beside the kept one."""
        review = self._review
        moment = review.moment
        self._is_asked_early = moment is None or moment.seq != review.seq
        if moment is None or self._is_asked_early:
            review.say("the moment is being fetched …")
        elif review.kept is None:
            self._keep(moment)
        elif review.kept.seq == moment.seq and self._other_seq is None:
            review.say("this is A: go to another moment, then compare")
        else:
            self._compare(moment)

    def compare_if_asked(self) -> None:
        """What was asked for before the moment was there."""
        review = self._review
        if self._is_asked_early and review.moment is not None and review.moment.seq == review.seq:
            self.action_compare()

    def _compare(self, moment: Moment) -> None:
        review = self._review
        if review.kept is not None and review.kept.seq == moment.seq:
            self.action_blink()  # A is shown in B's place: back to B, which is what is compared
            review.say("B: compare it with A from here")
            return
        assert review.kept is not None

        def decided(choice: Choice | None) -> None:
            if choice == "blink":
                self.action_blink()
            elif choice == "keep":
                self._keep(moment)

        review.ask(CompareDialog(review.kept, moment, review.timeline), decided)

    def _keep(self, moment: Moment) -> None:
        review = self._review
        review.kept, self._other_seq = moment, None
        review.show_place()
        key = first_key("compare", review.keymap)
        review.say(f"A is kept: go to another moment, {key} compares", "good")

    def action_blink(self) -> None:
        """The other one of A and B."""
        review = self._review
        if review.kept is None:
            review.say(f"{first_key('compare', review.keymap)} keeps a moment to blink with")
        elif review.seq != review.kept.seq:
            other = review.seq
            self._moves.go(review.kept.seq)
            self._other_seq = other
            review.say("A")
        elif self._other_seq is None:
            review.say("this is A: go to another moment to blink with")
        else:
            self._moves.go(self._other_seq)
            review.say("B")

    def action_forget_moment(self) -> None:
        """Nothing is kept."""
        review = self._review
        had_one, review.kept, self._other_seq = review.kept is not None, None, None
        review.show_place()
        review.say("A is forgotten" if had_one else "no moment is kept")
