"""The plate solver's own process: native code that may crash, hang or exceed any deadline.

The parent starts it with ``python -c``, talks to it through one socket and may kill it at any time.
It ends by itself as soon as the parent's end of the socket closes, even in the middle of a search:
a thread waits for that while the native code has released the interpreter's lock. It imports only
the standard library and ``astrometry``, so that a restart is fast.
"""

import os
import queue
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

MAX_SOLVERS = 4
"""Number of sets of index files kept open; files are mapped, so that a set costs little."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchRequest:
    """Request to the solver process for one search."""

    request_id: int
    index_files: tuple[str, ...]
    stars_xy_px: tuple[tuple[float, float], ...]
    """Positions of the stars, brightest first, in 0-based pixels."""
    scale_arcsec_px: tuple[float, float]
    position_deg: tuple[float, float, float] | None
    """RA, Dec and radius of the search, deg; None: the whole sky is searched."""
    depths: tuple[int, ...]
    """Star counts of successive searches: quads of depths[0] stars, then up to depths[1] etc."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchReply:
    """Reply of the solver process to one request."""

    request_id: int
    error: str = ""
    """Fault of the native library, or of the process; empty for none."""
    wcs_cards: dict[str, Any] | None = None
    """FITS cards of the plate by the matched quad; None when nothing matched."""
    stars: tuple[tuple[float, float, float], ...] = ()
    """RA, Dec (ICRS degrees) and VT of the index's stars in the field, brightest first."""


def main(socket_fd: int) -> None:
    """Answer requests until the parent's end of the socket closes."""
    connection = Connection(socket_fd)
    requests: queue.SimpleQueue[MatchRequest] = queue.SimpleQueue()

    def listen() -> None:
        while True:
            try:
                requests.put(connection.recv())
            except (EOFError, OSError):
                os._exit(0)

    threading.Thread(target=listen, daemon=True).start()
    try:
        import astrometry  # noqa: F401 - loaded now, so that the first search does not wait
    except ImportError as error:
        _say(connection, str(error))
    else:
        _say(connection, "")
    searcher = IndexSearcher()
    while True:
        request = requests.get()
        try:
            reply = searcher.search(request)
        except (ValueError, RuntimeError, OSError, AssertionError) as error:
            reply = MatchReply(request_id=request.request_id, error=str(error) or repr(error))
        _say(connection, reply)


def _say(connection: Connection, word: str | MatchReply) -> None:
    """Send a reply to the parent.

    The first message is instead the reason why this process can never search; empty: it can.
    """
    try:
        connection.send(word)
    except OSError:
        os._exit(0)


class IndexSearcher:
    """Search in index files, which it keeps open."""

    def __init__(self) -> None:
        self._solvers: dict[tuple[str, ...], Any] = {}

    def search(self, request: MatchRequest) -> MatchReply:
        """Search for the stars' plate; stop at the first match with odds of a billion to one."""
        import astrometry

        position = None
        if request.position_deg is not None:
            ra_deg, dec_deg, radius_deg = request.position_deg
            position = astrometry.PositionHint(ra_deg % 360.0, dec_deg, radius_deg)
        parameters = astrometry.SolutionParameters(
            # The plate is fitted again from all stars: the quad's own is start enough, and tuning
            # it here with SIP of order 3 took 220 of 230 ms.
            sip_order=0,
            tune_up_logodds_threshold=None,
            slices_generator=_slices(request.depths),
            logodds_callback=lambda _: astrometry.Action.STOP,
        )
        solution = self._solver(request.index_files).solve(
            # The native library counts pixels from 1, and its plate too.
            stars=[(x + 1.0, y + 1.0) for x, y in request.stars_xy_px],
            size_hint=astrometry.SizeHint(*request.scale_arcsec_px),
            position_hint=position,
            solution_parameters=parameters,
        )
        if not solution.has_match():
            return MatchReply(request_id=request.request_id)
        match = solution.best_match()
        stars = [(s.ra_deg, s.dec_deg, s.metadata.get("MAG_VT", 99.0)) for s in match.stars]
        return MatchReply(
            request_id=request.request_id,
            wcs_cards={name: value for name, (value, _) in match.wcs_fields.items()},
            stars=tuple(sorted(stars, key=lambda star: (star[2], star[0], star[1]))),
        )

    def _solver(self, index_files: tuple[str, ...]) -> Any:
        import astrometry

        if index_files not in self._solvers:
            while len(self._solvers) >= MAX_SOLVERS:
                self._solvers.pop(next(iter(self._solvers))).close()
            self._solvers[index_files] = astrometry.Solver([Path(name) for name in index_files])
        return self._solvers[index_files]


def _slices(depths: tuple[int, ...]) -> Callable[[int], Iterable[tuple[int, int]]]:
    def slices(count: int) -> Iterable[tuple[int, int]]:
        start = 0
        for depth in depths:
            if start >= count:
                return
            yield start, min(depth, count)
            start = depth

    return slices
