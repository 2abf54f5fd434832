"""The verb ledger: tracks that no catalogue explains, across nights."""

from typing import Annotated, Any

import typer

from rsoconsole.cli.words import output
from rsoconsole.cli.words.options import JsonOption

ledger_app = typer.Typer(invoke_without_command=True)
NumberArgument = Annotated[
    int, typer.Argument(metavar="NUMBER", min=1, help="Of the object: 7 for UCT 7.")
]
SimulatedOption = Annotated[
    bool, typer.Option("--simulated", help="The ledger of simulated nights.")
]


@ledger_app.callback()
def ledger(
    context: typer.Context, *, simulated: SimulatedOption = False, json_: JsonOption = False
) -> None:
    """List the objects that were seen and that no catalogue explains.

    The engine adds such tracks at the end of a night; 'rsoconsole identify
    SESSION --keep' adds those of a recorded one. Later tracks are compared with
    them in position and motion, with errors that grow with time, and get
    their name (UCT 7). Not added are tracks of fewer than 5 directions, ambiguous ones
    and those that were compared with no catalogue. Tracks of a simulated night
    are added by 'identify --keep' alone, to a ledger of its own (--simulated).
    Listed with the orbit is the magnitude (V) at 1000 km and a phase angle of
    90 deg, as of a diffuse sphere: the median of the track's, by its orbit.

    Example: rsoconsole ledger
    """
    if context.invoked_subcommand is not None:
        if simulated or json_:
            raise typer.BadParameter(f"give options behind the verb: {context.invoked_subcommand}")
        return
    list_(simulated=simulated, json_=json_)


@ledger_app.command("list")
def list_(*, simulated: SimulatedOption = False, json_: JsonOption = False) -> None:
    """List the objects: the same as 'rsoconsole ledger' alone.

    Example: rsoconsole ledger list --json
    """
    from rsoconsole.cli.words.ledger_words import HEADER, object_list_line
    from rsoconsole.session import ledger_path

    found = _read(simulated=simulated)
    if found.objects and not json_:
        output.say(HEADER)
    for each in found.objects:
        output.print_answer(json_, each, object_list_line)
    if not found.objects:
        output.print_to_stderr(f"no object is kept in {ledger_path(is_simulated=simulated)}")


@ledger_app.command()
def show(
    number: NumberArgument, *, simulated: SimulatedOption = False, json_: JsonOption = False
) -> None:
    """Show one object: its tracks, its orbit, its last direction.

    Example: rsoconsole ledger show 7
    """
    from rsoconsole.cli.words.ledger_words import object_detail_lines

    output.print_answer(
        json_, _read(simulated=simulated).object_by_number(number), object_detail_lines
    )


@ledger_app.command()
def rename(
    number: NumberArgument,
    name: Annotated[str, typer.Argument(help="What it is called from now on; '' for UCT again.")],
    *,
    simulated: SimulatedOption = False,
    json_: JsonOption = False,
) -> None:
    """Give an object a name.

    Example: rsoconsole ledger rename 7 "drifter near 60W"
    """
    from rsoconsole.session import Ledger, rename_change

    def change(before: Ledger) -> list[Any]:
        before.object_by_number(number)
        return [rename_change(number, name)]

    found = _changed(change, simulated=simulated).object_by_number(number)
    output.print_answer(json_, found, lambda known: f"UCT {number} is called {known.called}")


@ledger_app.command()
def join(
    number: NumberArgument,
    into: Annotated[int, typer.Argument(metavar="INTO", min=1, help="The object that it is.")],
    *,
    simulated: SimulatedOption = False,
    json_: JsonOption = False,
) -> None:
    """Join two numbers of one object: all tracks of NUMBER become tracks of INTO.

    Example: rsoconsole ledger join 9 7
    """
    from rsoconsole.session import Ledger, keep_change

    if number == into:
        raise typer.BadParameter("name two objects")

    def change(before: Ledger) -> list[Any]:
        before.object_by_number(into)
        return [keep_change(into, each) for each in before.object_by_number(number).tracks]

    found = _changed(change, simulated=simulated).object_by_number(into)
    output.print_answer(
        json_, found, lambda known: f"UCT {number} is {known.called}: {len(known.tracks)} tracks"
    )


@ledger_app.command()
def forget(
    number: NumberArgument, *, simulated: SimulatedOption = False, json_: JsonOption = False
) -> None:
    """Stop listing and matching an object; its number is not used again.

    Its lines stay in the file: nothing is erased.

    Example: rsoconsole ledger forget 7
    """
    from rsoconsole.session import Ledger, forget_change

    def change(before: Ledger) -> list[Any]:
        before.object_by_number(number)
        return [forget_change(number)]

    _changed(change, simulated=simulated)
    found = {"number": number, "forgotten": True}
    output.print_answer(
        json_, found, lambda _: f"UCT {number} is forgotten: it names no track any more"
    )


def _read(*, simulated: bool) -> Any:
    from rsoconsole.session import damage_words, ledger_path, read_ledger

    path = ledger_path(is_simulated=simulated)
    found = read_ledger(path)
    if words := damage_words(found.unreadable, path):
        output.print_to_stderr(f"rsoconsole: {words}")
    return found


def _changed(change: Any, *, simulated: bool) -> Any:
    from rsoconsole.cli.words.ledger_words import report_moved_ledger
    from rsoconsole.session import change_ledger, ledger_path

    found, aside = change_ledger(change, ledger_path(is_simulated=simulated))
    report_moved_ledger(aside)
    return found
