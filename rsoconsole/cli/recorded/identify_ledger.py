"""What the ledger of uncorrelated tracks has to do with the tracks that identify names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsoconsole.cli.words import output, say_moved_aside
from rsoconsole.errors import OrbitError, SessionError
from rsoconsole.orbits.identification import Identification
from rsoconsole.pipeline.orbits import FEWEST, Observed, Past, keep, longest_arc
from rsoconsole.records import LedgerName
from rsoconsole.session.ledgers import damage_words, ledger_path, read_ledger
from rsoconsole.session.reading import SessionReader
from rsoconsole.sky import utc_ns_to_iso


class SessionLedger:
    """The ledger beside one session or file of observations."""

    def __init__(
        self, path: Path, tracks: Sequence[Observed], named: Sequence[Identification]
    ) -> None:
        """``named``: each of the tracks, in their order."""
        is_session = tracks[0].track_id is not None
        self._folder = (path if path.is_dir() else path.parent) if is_session else None
        self._unknown = [
            each for each, name in zip(tracks, named, strict=True) if name.verdict == "unknown"
        ]
        self._named = [
            each for each, name in zip(tracks, named, strict=True) if name.verdict == "identified"
        ]
        is_simulated = (
            self._folder is not None
            and SessionReader(self._folder).about().get("is_simulated") is True
        )
        self._path = ledger_path(is_simulated=is_simulated)
        self._names = self._recognised()

    def report_of(self, number: int) -> dict[str, Any] | None:
        """What an earlier night calls a track; None where no night knows it."""
        name = self._names.get(number)
        if name is None:
            return None
        return {
            "number": name.number,
            "name": name.name,
            "probability": name.probability,
            "separation_arcsec": name.separation_arcsec,
            "t_last_utc": utc_ns_to_iso(name.t_last_utc_ns),
        }

    def keep(self) -> list[dict[str, Any]]:
        """Keep what no catalogue explains. Raises OrbitError for a file, and SessionError."""
        if self._folder is None:
            raise OrbitError("--keep takes a session: a file of observations has no tracks of one")
        kept = keep(self._folder, self._unknown, self._named, self._path)
        say_moved_aside(kept.moved_aside)
        for number in kept.too_short:
            output.complain(f"rsoconsole: track {number} has fewer than {FEWEST} directions")
        for number in kept.taken_back:
            output.complain(f"rsoconsole: track {number} has a catalogued name: not kept any more")
        return [
            {"track": each.track, "number": each.number, "is_new": each.is_new}
            for each in kept.tracks
        ]

    def _recognised(self) -> dict[int, LedgerName]:
        """By number of the track; the session's own entries name nothing."""
        try:
            ledger = read_ledger(self._path)
        except SessionError as error:
            output.complain(f"rsoconsole: {error}")
            return {}
        if words := damage_words(ledger, self._path):
            output.complain(f"rsoconsole: {words}")
        if not self._unknown:
            return {}
        session = "" if self._folder is None else self._folder.resolve().name
        arcs = {each.number: longest_arc(each.seen) for each in self._unknown}
        return Past(ledger.without(session)).names_of(arcs, self._unknown[0].site)
