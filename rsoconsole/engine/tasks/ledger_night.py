"""The ledger of uncorrelated tracks, as a night of the engine reads and writes it.

A simulated night does neither: a demo fills no operator's ledger.
"""

import logging
from pathlib import Path

from rsoconsole.errors import RsoconsoleError
from rsoconsole.pipeline.orbits import Past, keep_night
from rsoconsole.session.ledgers import damage_words, ledger_path, read_ledger

log = logging.getLogger(__name__)


def read_past(*, is_simulated: bool) -> tuple[Past | None, str | None]:
    """What no catalogue knew on earlier nights, and what is wrong with the ledger."""
    if is_simulated:
        return None, None
    try:
        ledger = read_ledger()
    except RsoconsoleError as error:
        return None, f"no track is named by the ledger: {error}"
    return Past(ledger), damage_words(ledger, ledger_path()) or None


def keep_uncorrelated(folder: Path) -> None:
    """Put the night's uncorrelated tracks into the ledger; the session is closed.

    Nothing is raised: the night is over, and `identify --keep` does it at any time.
    """
    try:
        kept = keep_night(folder)
    except RsoconsoleError as error:
        log.error(
            "no track was kept in the ledger: %s; do it by 'identify %s --keep'", error, folder
        )
        return
    except Exception:
        log.exception("no track was kept in the ledger: 'identify %s --keep' does it", folder)
        return
    if kept.moved_aside is not None:
        log.warning("the ledger was damaged: it is in %s as it was", kept.moved_aside)
    for each in kept.tracks:
        words = "a new one" if each.is_new else "known from before"
        log.info("track %s is kept in the ledger as UCT %s, %s", each.track, each.number, words)
