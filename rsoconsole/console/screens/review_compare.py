"""Two moments: one is kept, the other is where one is; side by side, or in turn."""

from rsoconsole.console.commands import first_key
from rsoconsole.console.screens.compare import Choice, CompareDialog
from rsoconsole.console.screens.review_moves import ReviewMoves
from rsoconsole.console.timeline import Moment


class ReviewCompare(ReviewMoves):
    """Keeps moment A."""

    kept: Moment | None = None
    """A; None while none is kept."""
    _other_seq: int | None = None
    """B, while A is shown in its place."""
    _is_asked_early = False
    """Whether to compare as soon as the moment is there that was gone to."""

    def action_compare(self) -> None:
        """Keep this moment, or show it beside the one that is kept."""
        moment = self.moment
        self._is_asked_early = moment is None or moment.seq != self.seq
        if moment is None or self._is_asked_early:
            self.say("the moment is being fetched …")
        elif self.kept is None:
            self._keep(moment)
        elif self.kept.seq == moment.seq and self._other_seq is None:
            self.say("this is A: go to another moment, then compare")
        else:
            self._compare(moment)

    def compare_if_asked(self) -> None:
        """What was asked for before the moment was there."""
        if self._is_asked_early and self.moment is not None and self.moment.seq == self.seq:
            self.action_compare()

    def _compare(self, moment: Moment) -> None:
        if self.kept is not None and self.kept.seq == moment.seq:
            self.action_blink()  # A is shown in B's place: back to B, which is what is compared
            self.say("B: compare it with A from here")
            return
        assert self.kept is not None

        def decided(choice: Choice | None) -> None:
            if choice == "blink":
                self.action_blink()
            elif choice == "keep":
                self._keep(moment)

        self.app.push_screen(CompareDialog(self.kept, moment, self.timeline), decided)

    def _keep(self, moment: Moment) -> None:
        self.kept, self._other_seq = moment, None
        self.show_place()
        key = first_key("compare", self.keymap)
        self.say(f"A is kept: go to another moment, {key} compares", "good")

    def action_blink(self) -> None:
        """The other one of A and B."""
        if self.kept is None:
            self.say(f"{first_key('compare', self.keymap)} keeps a moment to blink with")
        elif self.seq != self.kept.seq:
            other = self.seq
            self.go(self.kept.seq)
            self._other_seq = other
            self.say("A")
        elif self._other_seq is None:
            self.say("this is A: go to another moment to blink with")
        else:
            self.go(self._other_seq)
            self.say("B")

    def action_forget_moment(self) -> None:
        """Nothing is kept."""
        had_one, self.kept, self._other_seq = self.kept is not None, None, None
        self.show_place()
        self.say("A is forgotten" if had_one else "no moment is kept")
