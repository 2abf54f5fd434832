"""What happened to the clock by which a night was recorded, for those who use its times."""

from rsoconsole.records import Event
from rsoconsole.session.reading.reader import SessionReader
from rsoconsole.sky import utc_ns_to_iso


def clock_notes(reader: SessionReader) -> tuple[str, ...]:
    """When and what, a line each, in order; empty for a night of one steady clock.

    Raises SessionError where the session cannot be read.
    """
    return tuple(
        clock_note(t_utc_ns, record)
        for _, t_utc_ns, record in reader.records(kinds=(Event,))
        if isinstance(record, Event) and is_clock_fault(record)
    )


def is_clock_fault(event: Event) -> bool:
    """Whether it tells of one."""
    return event.topic == "clock" and event.level != "info"


def clock_note(t_utc_ns: int, event: Event) -> str:
    """The instant and what happened, without what the engine made of it."""
    return f"{utc_ns_to_iso(t_utc_ns, 0)} {event.text.partition(': ')[0]}"
