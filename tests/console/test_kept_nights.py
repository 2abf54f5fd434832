"""A night's fold changes rows in their place only until somebody has seen them, and shares them."""

from pathlib import Path

from rsoconsole.night import Night
from rsoconsole.night.night_view import CHUNK, in_chunks
from rsoconsole.records import DONE, CycleTiming, FollowedAgain, OperatorAction, Ruling
from rsoconsole.session import SessionReader
from tests.nights import eventful_night


def test_versions_of_a_list_share_what_they_have_alike() -> None:
    items = [object() for _ in range(3 * CHUNK + 5)]
    first = in_chunks(items[: 2 * CHUNK + 9], ())
    later = in_chunks(items, first)
    assert [item for chunk in later for item in chunk] == items
    assert [a is b for a, b in zip(first, later, strict=False)] == [True, True, False]
    changed = in_chunks([object(), *items[1:]], later)
    assert [a is b for a, b in zip(changed, later, strict=True)] == [False, True, True, True]
    assert in_chunks([], later) == ()


def test_what_was_given_away_stays_as_it_was_however_the_night_goes_on(tmp_path: Path) -> None:
    writer = eventful_night.write(tmp_path / "night", 40)
    writer.close()
    reader = SessionReader(writer.folder)
    alone, looked_at = (Night(reader.folder, reader.read_meta(), reader.config()) for _ in range(2))
    seen = []
    for number, (seq, t_utc_ns, record) in enumerate(reader.records()):
        alone.fold_record(t_utc_ns, record, seq)
        looked_at.fold_record(t_utc_ns, record, seq)
        newest = looked_at.newest_frame_ids()
        given: list[object] = [looked_at.checkpoint() if number % 7 == 0 else None]
        if number % 3 == 0:
            view = looked_at.view()
            given += [view.rows[-3:], view.measured]
        if newest and number % 2 == 0:
            given += [looked_at.row(newest[0]), looked_at.frame(newest[0])]
        seen.append((given, repr(given)))
    assert len(seen) > 200
    for given, words in seen:
        assert repr(given) == words
    assert looked_at.view() == alone.view()


def test_a_night_that_goes_back_is_as_it_was(tmp_path: Path) -> None:
    writer = eventful_night.write(tmp_path / "night", 30)
    writer.close()
    reader = SessionReader(writer.folder)
    night = Night(reader.folder, reader.read_meta(), reader.config())
    records = list(reader.records())
    kept, then = None, None
    for seq, t_utc_ns, record in records:
        night.fold_record(t_utc_ns, record, seq)
        if seq == records[len(records) // 2][0]:
            kept, then = night.checkpoint(), night.view()
    assert kept is not None
    end = night.view()
    night.restore(kept)
    assert night.view() == then
    for seq, t_utc_ns, record in records[len(records) // 2 + 1 :]:
        night.fold_record(t_utc_ns, record, seq)
    assert night.view() == end


def test_a_frame_that_somebody_marks_in_is_followed_again_however_many_came_meanwhile(
    tmp_path: Path,
) -> None:
    writer = eventful_night.write(tmp_path / "night", 40)
    writer.close()
    reader = SessionReader(writer.folder)
    night = Night(reader.folder, reader.read_meta(), reader.config())
    begun = OperatorAction(
        verb="begin_mark", arguments={"frame": 11, "on": True}, outcome=DONE, by="console"
    )
    for seq, t_utc_ns, record in reader.records():
        night.fold_record(t_utc_ns, record, seq)
        if isinstance(record, CycleTiming) and record.frame_id == 12:
            night.fold_record(t_utc_ns, begun)
    row = night.row(11)
    assert row is not None
    assert row.residual_arcsec is not None
    night.fold_record(0, Ruling(frame_id=11, refused=(), by="console"))
    night.fold_record(0, FollowedAgain(frame_id=11))
    again = night.row(11)
    assert again is not None
    assert (again.residual_arcsec, again.is_followed) == (None, False)
