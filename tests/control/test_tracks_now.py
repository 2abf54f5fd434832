"""Every track in the engine's status, and the next aim before the mount goes there."""

import json
from dataclasses import replace

import pytest

from rsoconsole.console.words.track_lines import track_list_lines
from rsoconsole.control import (
    NextAim,
    Outcome,
    Status,
    TrackStatus,
    next_aim_parts,
    read_status,
    status_json,
    track_table,
)
from rsoconsole.records import Photometry, SlewCommand
from tests.cli.test_cli_telescope import engine_that, home, rsoconsole
from tests.makers import streak_light
from tests.nights import eight_tracks as eight
from tests.pipeline.test_track_lead import night_of_two
from tests.rigs.engine_rig import Rig, command_handler_of, told

__all__ = ["home"]
TRACKS = (
    TrackStatus(
        track_id=2,
        name="ASTRA 1KR",
        is_lead=True,
        state="TRACK",
        age_s=724.0,
        residual_east_arcsec=0.312,
        residual_north_arcsec=-1.5,
        nis=1.84,
        snr=61.3,
        is_in_next_field=True,
    ),
    TrackStatus(
        track_id=11,
        name="A NAME THAT IS LONGER THAN ITS COLUMN",
        state="COAST",
        misses=12,
        is_kept=True,
        age_s=40_000.0,
        is_in_next_field=False,
    ),
)
AIM = NextAim(
    ra_icrs_deg=150.0,
    dec_icrs_deg=-5.0,
    t_utc_ns=1_687_406_400_000_000_000,
    policy="most",
    reason="filter, 3 of 4 in the field",
    moves_arcmin=4.21,
)
HEADS = ("state", "age", "residual/arcsec", "NIS", "SNR", "next")
ROW = ("TRACK", "12m04", "+0.31", "-1.50", "1.8", "61", "in")
STATUS = Status(state="TRACK", holder="autonomy", frame_id=24, tracks=TRACKS, next_aim=AIM)


def test_the_shell_lists_every_track_and_the_next_aim():
    with engine_that(lambda _: Outcome(ok=True, data=status_json(STATUS))):
        plain, as_json = rsoconsole("status"), rsoconsole("status", "--json")
    lines = plain.stdout.splitlines()
    assert lines[0] == "TRACK · autonomy has the mount · frame 24"
    assert lines[1].split() == ["track", "name", *HEADS]
    assert lines[2].split() == ["2*", "ASTRA", "1KR", *ROW]
    assert lines[3].split()[-7:] == ["COAST", "12+", "11h06", "-", "-", "-", "out"]
    assert "A NAME THAT IS LONGER…" in lines[3]
    assert all(len(line) <= 80 for line in lines[1:4])
    assert lines[4] == (
        "next aim, most: filter, 3 of 4 in the field · α 10:00:00.0 δ -05:00:00"
        " · 04:00:00 · slew 4.2′"
    )
    told_of = json.loads(as_json.stdout)
    assert [each["track_id"] for each in told_of["tracks"]] == [2, 11]
    assert told_of["tracks"][0]["nis"] == 1.84
    assert told_of["next_aim"]["policy"] == "most"
    assert read_status(told_of) == STATUS


@pytest.mark.parametrize(
    ("band", "head", "figure", "words"),
    [
        ("V", "mag", "12.41", "mag 12.41±.03 V"),
        ("instrumental", "inst", "-9.31", "mag -9.31±.03 inst"),
    ],
)
def test_the_shell_says_how_bright_each_track_is(band, head, figure, words):
    lead = replace(TRACKS[0], mag=float(figure), mag_sigma=0.03, band=band)
    lit = replace(STATUS, tracks=(lead, TRACKS[1]), limiting_mag=14.2, zero_point_mag=22.0)
    with engine_that(lambda _: Outcome(ok=True, data=status_json(lit))):
        plain, as_json = rsoconsole("status"), rsoconsole("status", "--json")
    lines = plain.stdout.splitlines()
    assert lines[0].endswith(f"frame 24 · {words}")
    assert lines[1].split() == ["track", "name", *HEADS[:-1], head, "next"]
    assert lines[2].split()[-3:] == ["61", figure, "in"]
    assert lines[3].split()[-3:] == ["-", "-", "out"]
    assert all(len(line) <= 80 for line in lines[1:4])
    said = json.loads(as_json.stdout)
    assert (said["limiting_mag"], said["zero_point_mag"]) == (14.2, 22.0)
    assert [said["tracks"][0][key] for key in ("mag", "mag_sigma", "band")] == [
        float(figure),
        0.03,
        band,
    ]
    assert read_status(said) == lit


def test_an_instrumental_magnitude_among_others_in_v_has_no_figure():
    tracks = (
        replace(TRACKS[0], mag=12.41, mag_sigma=0.03, band="V"),
        replace(TRACKS[1], mag=-9.3, mag_sigma=0.03, band="instrumental"),
    )
    head, first, second = track_table(replace(STATUS, tracks=tracks))
    assert head.split()[-2:] == ["mag", "next"]
    assert first.split()[-2:] == ["12.41", "in"]
    assert second.split()[-2:] == ["inst", "out"]


def test_one_track_alone_is_one_line_for_tmux():
    alone = Status(state="TRACK", holder="autonomy", frame_id=24, tracks=TRACKS[:1], next_aim=AIM)
    with engine_that(lambda _: Outcome(ok=True, data=status_json(alone))):
        assert rsoconsole("status").stdout.count("\n") == 1


def status_of(r: Rig) -> Status:
    return read_status(told(command_handler_of(r), "status", {}).data)


def test_the_engine_tells_each_track_as_its_last_frame_left_it():
    r = night_of_two()
    said = status_of(r)
    lead, other = said.tracks
    assert (lead.track_id, lead.is_lead, lead.state) == (1, True, "TRACK")
    assert (other.track_id, other.is_lead, other.state) == (2, False, "TRACK")
    track = r.engine.following.track
    assert (lead.residual_east_arcsec, lead.residual_north_arcsec) == track.innovation_arcsec
    assert lead.nis == track.nis
    assert lead.snr is not None
    first = r.engine.following.tracks[0].since_utc_ns
    assert lead.age_s == pytest.approx((said.now_utc_ns - first) / 1e9)
    assert lead.age_s > 100.0
    r.reducer.frames = set()
    r.engine.run(frames=r.engine.frame_id + 2)
    lead, other = status_of(r).tracks
    assert (lead.state, lead.misses, lead.nis) == ("COAST", 2, None)
    assert told(command_handler_of(r), "disarm", {}).ok
    r.engine.commands.execute_waiting()
    said = status_of(r)
    assert (said.tracks, said.next_aim) == ((), None)


def test_the_engine_tells_the_magnitude_of_what_each_track_took_last():
    r = night_of_two()
    first, second = (each.taken.measurement_id for each in r.engine.following.tracks)
    assert status_of(r).limiting_mag is None
    lights = (streak_light(first, 11.0), streak_light(second, 12.0, band="instrumental"))
    frame_id = r.engine.frame_id
    record = Photometry(frame_id=frame_id, streaks=lights, zero_point_mag=22.0, limiting_mag=14.2)
    r.engine.frames.note_light(record)
    said = status_of(r)
    assert (said.zero_point_mag, said.limiting_mag) == (22.0, 14.2)
    assert [each.mag for each in said.tracks] == [11.0, 12.0]
    assert [each.band for each in said.tracks] == ["V", "instrumental"]
    assert said.tracks[0].mag_sigma == 0.03
    # Both are missed: the magnitudes of their last streaks stay, the frame's own do not.
    r.reducer.frames = set()
    r.engine.run(frames=frame_id + 1)
    r.engine.frames.note_light(Photometry(frame_id=frame_id + 1))
    said = status_of(r)
    assert (said.zero_point_mag, said.limiting_mag) == (None, None)
    assert [(each.state, each.mag) for each in said.tracks] == [("COAST", 11.0), ("COAST", 12.0)]


def test_the_aim_after_the_next_is_told_before_the_mount_goes_there():
    r = night_of_two()
    aim = status_of(r).next_aim
    assert (aim.policy, aim.reason) == ("lead", "orbit")
    ordered = r.memory.of(SlewCommand)
    r.engine.run(frames=r.engine.frame_id + 1)
    slew = r.memory.of(SlewCommand)[-1]
    assert slew not in ordered
    assert slew.t_aim_utc_ns == pytest.approx(aim.t_utc_ns, abs=2e9)
    assert slew.dec_icrs_deg == pytest.approx(aim.dec_icrs_deg, abs=2 / 3600)
    # The policy's word shows before a slew follows it.
    sent = len(r.memory.of(SlewCommand))
    assert told(command_handler_of(r), "set", {"name": "aim.policy", "value": "group"}).ok
    r.engine.commands.execute_waiting()
    assert len(r.memory.of(SlewCommand)) == sent
    said = status_of(r)
    assert (said.next_aim.policy, said.next_aim.reason) == (
        "group",
        "orbit, 2 of 2 in the field",
    )
    assert [each.is_in_next_field for each in said.tracks] == [True, True]
    middle = sum(each.track.x[2] for each in r.engine.following.tracks) / 2
    assert said.next_aim.dec_icrs_deg == pytest.approx(middle, abs=0.005)


def test_the_list_shows_the_next_aim_where_every_track_has_its_row():
    night = eight.night_of_eight().view()
    for size, is_there in (((35, 17), True), ((60, 17), True), ((35, 11), False)):
        lines = track_list_lines(night, None, None, *size, next_aim=AIM)
        said = ["".join(text for text, _ in line) for line in lines]
        assert len(said) <= size[1]
        assert all(len(line) <= size[0] for line in said)
        words = " ".join(" ".join(said).split())
        assert ("next aim, most: filter" in words) == is_there
        assert all(any(line[1:4].strip(" *") == f"{n}" for line in said) for n in range(1, 9))


def test_nothing_followed_has_no_table():
    assert track_table(Status()) == []
    assert "no slew" in next_aim_parts(NextAim(policy="lead"))
