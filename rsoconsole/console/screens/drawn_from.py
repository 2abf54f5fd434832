"""Which part of a screen is drawn from what is known: drawn again when that has changed, once."""

from collections.abc import Callable, Iterable, Mapping

from textual.screen import Screen

Draw = Callable[[], None]


class DrawnFrom:
    """Draws what is drawn from a reactive of the screen after the message that has changed it.

    A message changes several as a rule: what is drawn from more than one of them is drawn once.
    """

    def __init__(self, screen: Screen[None], table: Mapping[Draw, Iterable[str]]) -> None:
        """``table``: how each part is drawn, and the names of the reactives it is drawn from."""
        self._screen, self._draws = screen, tuple(table)
        self._stale: set[Draw] = set()
        for draw, names in table.items():
            for name in names:
                screen.watch(screen, name, self._watcher(draw), init=False)

    def _watcher(self, draw: Draw) -> Draw:
        def changed() -> None:
            if not self._stale:
                self._screen.call_next(self.draw)
            self._stale.add(draw)

        return changed

    def draw(self) -> None:
        """What has changed, in the order of the table."""
        stale, self._stale = self._stale, set()
        for draw in self._draws:
            if draw in stale:
                draw()

    def draw_all(self) -> None:
        """The first paint."""
        self._stale.clear()
        for draw in self._draws:
            draw()
