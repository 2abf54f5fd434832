"""Recorded sessions in words and as JSON: the output of the verb sessions."""

import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.cli.words import output
from rsoconsole.control import SCHEMA
from rsoconsole.words import count_words, duration_words, file_size, utc_text

if TYPE_CHECKING:
    from rsoconsole.session import (
        ArchiveResult,
        Finding,
        PruningStep,
        RepairResult,
        SessionSummary,
        Verification,
    )

MAX_ALIKE = 3
"""Largest number of findings of one sort that are listed singly; --json lists all."""


def schema_keys(of_session: Any) -> dict[str, Any]:
    """Return the schema numbers of a session and of the JSON under keys of their own.

    The key ``schema`` alone is ambiguous: in the JSON of sessions it is the session's.
    """
    return {"session_schema": of_session, "json_schema": SCHEMA}


HEADER = "begin, UTC         length  frames  followed       size  state     session"


def summary_words(each: "SessionSummary") -> str:
    """A session's line under ``HEADER``; its name is last, where a narrow terminal may wrap it."""
    name = each.folder.name
    if each.fault is not None:
        size = file_size(each.size_bytes)
        return f"{'-':16} {'-':>8} {'-':>7} {'-':>9} {size:>10}  {each.state}  {name}: {each.fault}"
    begin = utc_text(each.t_first_utc_ns, "dated minute", "") if each.t_first_utc_ns else "-"
    share = "-" if each.followed_share is None else f"{100 * each.followed_share:.0f} %"
    rescue = "" if each.rescues is None else f", rescue of {each.rescues}"
    marks = (
        rescue
        + (", KEEP" if each.is_kept else "")
        + "".join(f", branch {b}" for b in each.branches)
    )
    length = "-" if each.duration_s is None else duration_words(each.duration_s)
    return (
        f"{begin:16} {length:>8} {each.frames:7d} {share:>9} "
        f"{file_size(each.size_bytes):>10}  {each.state:8}  {name}{marks}"
    )


def verification_lines(found: "Verification") -> Iterator[str]:
    """Yield lines on the findings of a verification, at most ``MAX_ALIKE`` of each sort."""
    digest = {"confirmed": "digest confirmed", "differs": "DIGEST DIFFERS", "none": "no digest"}
    state = "sound" if found.is_sound else "DAMAGED"
    yield (
        f"{found.session}: {state}, {found.state}; {found.records} records, "
        f"{digest[found.digest]}; {found.files} files, {file_size(found.bytes)} read"
    )
    alike: Counter[tuple[str, str]] = Counter()
    for each in found.findings:
        sort = (each.severity, each.what)
        alike[sort] += 1
        if alike[sort] <= MAX_ALIKE:
            yield _finding_words(each)
    for (severity, what), number in alike.items():
        if number > MAX_ALIKE:
            yield f"  {severity:8} and {number - MAX_ALIKE} more: {what}"


def _finding_words(each: "Finding") -> str:
    remedy = "" if each.remedy == "nothing to do" else f": {each.remedy}"
    return f"  {each.severity:8} {each.place}: {each.what}{remedy}"


def repair_lines(done: "RepairResult") -> Iterator[str]:
    """Lines on the repair of a session."""
    saved = done.recovered
    if saved is not None:
        lost = f", {saved.missing} missing" if saved.missing else ", none missing up to the last"
        again = "" if saved.is_new else " already"
        yield (
            f"{done.session}: damaged, and left as it is; {saved.records} records{lost} and "
            f"{saved.files} files are saved{again} in {saved.folder}"
        )
        yield from _rescue_lines(done)
        return
    deeds = [
        *(["closed, with the digest of its log"] if done.closed else []),
        *(["write-ahead log folded in"] if done.folded else []),
        *([f"{len(done.adopted)} files taken in"] if done.adopted else []),
        *([f"{len(done.removed)} half-written files removed"] if done.removed else []),
    ]
    yield f"{done.session}: {'; '.join(deeds) or 'nothing to do'}"
    for path, why in done.left.items():
        yield f"  left     {path}: {why}"
    yield from _rescue_lines(done)


def _rescue_lines(done: "RepairResult") -> Iterator[str]:
    for each in done.merged:
        yield (
            f"  merged   {each.rescue}: {each.records} records and {each.files} rows of files are"
            f" now in {each.session}, read back; the rescue session is removed"
        )
    for path, why in done.unmerged.items():
        yield f"  kept     {path}, a rescue session, is not merged: {why}"


def archive_words(made: "ArchiveResult") -> str:
    """One line on an archive: its path, files and size."""
    gone = "; the original is removed" if made.is_removed else ""
    size = file_size(made.bytes)
    return f"{made.path}: {made.files} files, {size}, read back and verified{gone}"


def pruning_step_words(step: "PruningStep") -> str:
    """One line on a step of pruning."""
    deed = f"{file_size(step.bytes):>9}" if step.goes else "    stays"
    return f"{deed}  {step.session.name:36} {step.why}"


def print_pruning_total(
    steps: "tuple[PruningStep, ...]", folder: Path, what: str, is_done: bool
) -> None:
    """Print the total of a pruning plan, or, with ``is_done``, of what was pruned.

    ``what``: frames, previews or all.
    """
    going = [step for step in steps if step.goes]
    total = file_size(sum(step.bytes for step in going))
    number = count_words(len(going), "session")
    what_goes = f"{number} whole" if what == "all" else f"the {what} of {number}"
    free = shutil.disk_usage(folder).free if folder.exists() else 0
    if is_done:
        output.say(f"pruned {what_goes}, {total}; {file_size(free)} are free")
    elif going:
        output.say(
            f"{what_goes} would go, {total}; {file_size(free)} are free now: "
            "nothing is done without --yes"
        )
    else:
        output.say(f"nothing would go; {file_size(free)} are free")
