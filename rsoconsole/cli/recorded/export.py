"""The verbs export and figures: a night in exchange formats, and drawn for print."""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer

from rsoconsole.base import ExportError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import JsonOption, SessionArgument

AnyFormat: TypeAlias = Literal[
    "csv", "ecsv", "jsonl", "tdm", "tdm-xml", "iod", "udl", "score", "fits", "regions", "html"
]
MESSAGES = ("tdm", "tdm-xml", "iod", "udl", "score")
STDOUT = "-"
FOLDER_KINDS = ("fits", "regions")
"""Formats of ``export`` that write a folder with one file per frame."""


def export(
    session: SessionArgument,
    *,
    format_: Annotated[AnyFormat, typer.Option("--format", help="What to make of it.")],
    out: Annotated[
        str | None,
        typer.Option(
            metavar="PATH",
            help="Where to write: a file, for fits and regions a folder, - for stdout; "
            "default: SESSION/branches/exports.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over existing files.")] = False,
    everything: Annotated[
        bool,
        typer.Option(
            "--all", help="Tables also hold what the operator's word replaced, and say so."
        ),
    ] = False,
    frames: Annotated[
        str | None, typer.Option(metavar="3,9-12", help="fits, regions: these frames alone.")
    ] = None,
    track: Annotated[
        int | None, typer.Option(help="tdm, iod, udl, score: this track alone.")
    ] = None,
    norad: Annotated[
        int | None,
        typer.Option(help="tdm, iod, udl, score: the object's catalogue number, if known."),
    ] = None,
    cospar: Annotated[
        str | None,
        typer.Option(metavar="2009-064A", help="tdm, iod, udl: its international designation."),
    ] = None,
    station: Annotated[
        str, typer.Option(help="iod: your station's number; 9999 has none.")
    ] = "9999",
    sky: Annotated[
        str, typer.Option(help="iod: the sky, one of E G F P B T, excellent to terrible.")
    ] = " ",
    site_line: Annotated[
        bool | None,
        typer.Option(
            "--site-line/--no-site-line",
            help="iod: begin with your station and its place, as on SeeSat-L; default: in files.",
        ),
    ] = None,
    originator: Annotated[str, typer.Option(help="tdm, udl: who makes it.")] = "RSOCONSOLE",
    observer_email: Annotated[
        str | None, typer.Option(help="score: your address, to which it confirms.")
    ] = None,
    observer_orcid: Annotated[
        str | None, typer.Option(help="score: your ORCID; of several observers with commas.")
    ] = None,
    detector: Annotated[
        str | None, typer.Option(metavar="CCD|CMOS|OTHER", help="score: kind of detector.")
    ] = None,
    filter_: Annotated[
        str | None,
        typer.Option("--filter", help="score: what is in front of the camera; CLEAR: nothing."),
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Export a night: tables, CCSDS TDM, IOD, UDL, SCORE, solved FITS, DS9 regions, a report.

    csv, ecsv, jsonl: every measurement with its errors and magnitude, whether a track accepted it
    or why none did, and the track's prediction, residual, NIS and state after it.

    tdm, tdm-xml, iod, udl: the measurements that the tracks accepted, in exchange formats;
    without streaks that the frame's edge cuts. udl is a file of EOObservation records; nothing is
    uploaded.

    score: magnitudes as the repository SCORE of the IAU CPS takes them; it requires --norad,
    --observer-email, --observer-orcid, --detector and --filter.

    fits, regions: kept frames with their plate solution in the header; their streaks for DS9.

    html: a report in one file, which needs no network.

    An existing file is left alone unless --force is given.

    Example: rsoconsole export sessions/intelsat-14 --format tdm --norad 36097 --out -
    """
    if out == STDOUT and (json_ or format_ in FOLDER_KINDS):
        raise typer.BadParameter(
            "--out - prints one text: not with --json, not for fits or regions"
        )
    if format_ == "html":
        _report(session, out, json_, is_forced=force)
        return
    from rsoconsole.library import ExportOptions, ScoreOptions, Target, parse_numbers

    try:
        options = ExportOptions(
            everything=everything,
            track=track,
            target=Target(norad_id=norad, cospar=cospar),
            station=station,
            sky=sky,
            site_line=out != STDOUT if site_line is None else site_line,
            originator=originator,
            score=ScoreOptions(
                email=observer_email, orcid=observer_orcid, detector=detector, passband=filter_
            ),
            frames=None if frames is None else parse_numbers(frames),
            is_forced=force,
        )
    except (ValueError, ExportError) as error:
        raise typer.BadParameter(str(error)) from error
    _export(session, format_, out, options, json_)


def _export(session: Path, kind: Any, out: str | None, options: Any, json_: bool) -> None:
    from rsoconsole.library import export as write
    from rsoconsole.library import render

    new_folder = _folder_to_make(kind, out)
    if out == STDOUT:
        with progress_bar(f"export {kind}"):
            text, made = render(session, kind, options)
        output.emit_text(text)
    else:
        with progress_bar(f"export {kind}"):
            made = write(session, kind, None if out is None else Path(out), options)
        output.print_answer(json_, made, lambda each: map(str, each.files))
    _say_created(new_folder)
    _say_left_out(made)
    if made.format in MESSAGES and not options.target.is_known:
        _say_recorded_name(session)


def _folder_to_make(kind: str, out: str | None) -> Path | None:
    """The folder that --out names and that is not there yet; None where there is nothing to make.

    The session's own folder for exports needs no word.
    """
    if out is None or out == STDOUT:
        return None
    folder = Path(out) if kind in FOLDER_KINDS else Path(out).parent
    return None if folder.exists() else folder


def _say_created(folder: Path | None) -> None:
    if folder is not None:
        output.print_to_stderr(f"created the folder {folder}")


def _say_recorded_name(session: Path) -> None:
    """Print the engine's identification, and the option with which the message names it."""
    from rsoconsole.session import SessionReader

    rows = SessionReader(session).view_rows("identifications")
    last = {row["track_id"]: row for row in rows if not row["is_superseded"]}
    named = {n: row for n, row in last.items() if row["verdict"] == "identified"}
    for track_id, row in sorted(named.items()):
        name, number = row["name"], row["norad_id"]
        if len(last) == 1:
            output.print_to_stderr(
                f"on record it is {name} ({number}): --norad {number} writes that"
            )
        else:
            output.print_to_stderr(
                f"on record track {track_id} is {name} ({number}):"
                f" --track {track_id} --norad {number} writes that"
            )


def _say_left_out(made: Any) -> None:
    if made.left_out:
        words = ", ".join(f"{number} {what}" for what, number in made.left_out.items())
        output.print_to_stderr(f"left out: {words}")
    if made.is_simulated and made.format in MESSAGES:
        output.print_to_stderr("this night was simulated: send it to nobody")


def _report(session: Path, out: str | None, json_: bool, *, is_forced: bool) -> None:
    from rsoconsole.library import render_report, save_text

    with progress_bar("report"):
        report = render_report(session)
    if out == STDOUT:
        output.emit_text(report.html)
        return
    new_folder = _folder_to_make("html", out)
    path = None if out is None else Path(out)
    made = save_text(session, report.html, report.made, path, is_forced=is_forced)
    _say_created(new_folder)
    output.print_answer(json_, made, lambda _: str(made.path))


FigureFormat: TypeAlias = Literal["png", "svg", "pdf"]


def figures(
    session: SessionArgument,
    *,
    out: Annotated[
        Path | None, typer.Option(help="Where to write; default: SESSION/branches/figures.")
    ] = None,
    format_: Annotated[FigureFormat, typer.Option("--format", help="Kind of file.")] = "png",
    truth: Annotated[
        Path | None,
        typer.Option(help="A simulation's truth: adds the errors against what really was."),
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Draw confidence, track, residuals and NIS of a session, as the paper does.

    Measured red squares, updated blue triangles, predicted green circles, 3-sigma bounds dashed;
    frames in which the object was missed are shaded. Existing figures are replaced.
    Example: rsoconsole figures ~/.local/share/rsoconsole/sessions/NIGHT --format pdf
    """
    from rsoconsole.library import write_figures

    folder = session / "branches" / "figures" if out is None else out
    for path in write_figures(session, folder, truth=truth, file_format=format_):
        output.emit_json({"figure": str(path)}) if json_ else output.say(str(path))
