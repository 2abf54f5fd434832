"""The verb goto: parses a direction as the console does, shows it, and sends it."""

from typing import TYPE_CHECKING, Annotated

import typer

from rsoconsole.base import ControlError
from rsoconsole.cli.telescope.order import send_and_report
from rsoconsole.cli.telescope.waiting import Goal, WaitOption, arrival_goal, session_config
from rsoconsole.cli.words import output
from rsoconsole.cli.words.options import JsonOption, OverrideOption, SocketOption
from rsoconsole.cli.words.usage import as_usage_error
from rsoconsole.control import Goto, Outcome, Preview

if TYPE_CHECKING:
    from rsoconsole.control import Status
    from rsoconsole.pipeline import ParsedDirection

TargetArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="TARGET",
        help="A satellite of your element files, a star, M31, Moon, Jupiter; 'alt 50 az 180'; "
        "RA and Dec as 05:32:11 -04:52:10, 20.9h -4.8 or 83.05 -4.87.",
    ),
]


def goto(
    target: TargetArgument,
    override: OverrideOption = None,
    wait: WaitOption = False,
    socket: SocketOption = None,
    json_: JsonOption = False,
) -> None:
    """Move the telescope by hand, within its limits; autonomy waits until 'rsoconsole resume'.

    TARGET is written as in the console's go-to; the verb says how it was understood before
    anything moves. A number that may be hours or degrees is refused with both readings.

    The answer is the mount's: on its way, or refused and why. With --wait it comes when the mount
    is measured to be at rest there, or says why it is not.

    Example: rsoconsole goto "alt 50 az 180"
    """
    from rsoconsole.control import (
        ControlClient,
        MovePreview,
        Sender,
        ask_engine,
        ask_status,
        preview_lines,
        read_record,
    )

    client = ControlClient(socket, sender=Sender(name="command"))
    status = ask_status(client)
    found = _understood(" ".join(target), status)
    move = Goto(
        ra_icrs_deg=found.ra_icrs_deg,
        dec_icrs_deg=found.dec_icrs_deg,
        override=tuple(override or ()),
    )
    preview = read_record(MovePreview, ask_engine(client, Preview(move=move)))
    if not json_:
        careful = [f"careful  {found.caution}"] if found.caution else []
        output.say(f"understood: {found.words}", *careful, *preview_lines(preview))
    facts = {
        "understood": found.words,
        "caution": found.caution or None,
        "ra": found.ra_icrs_deg,
        "dec": found.dec_icrs_deg,
        "alt": preview and preview.alt_deg,
        "az": preview and preview.az_deg,
        "way_deg": preview and preview.way_deg,
        "slew_s": preview and preview.slew_s,
        "margins_deg": dict(preview.margins_deg) if preview else None,
    }

    def goal_of(taken: Outcome) -> Goal:
        # Some look beside where they are told to look: the mount is told what makes up for it.
        ra_icrs_deg = float(taken.data.get("command_ra_icrs_deg", move.ra_icrs_deg))
        dec_icrs_deg = float(taken.data.get("command_dec_icrs_deg", move.dec_icrs_deg))
        near_arcmin = session_config(status.session).mount.arrival_arcmin
        return arrival_goal(ra_icrs_deg, dec_icrs_deg, near_arcmin)

    send_and_report(
        move, "goto", client, json_=json_, goal_of=goal_of if wait else None, more=facts
    )


def _understood(text: str, status: "Status") -> "ParsedDirection":
    """Direction of the text at the engine's own time and site. Raises BadParameter for none."""
    from rsoconsole.pipeline import TargetNames, parse_direction

    config = session_config(status.session)
    if status.now_utc_ns is None:
        raise ControlError("the engine does not say what time it has: it is of another version")
    names = TargetNames.load(config.catalogue.tle_files)
    with as_usage_error():
        return parse_direction(text, config.site.to_site(), status.now_utc_ns, names)
