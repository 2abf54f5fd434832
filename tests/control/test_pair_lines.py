"""The neighbours of each track in the list, and who is missing from the field."""

import json
from dataclasses import replace

from rsoconsole.console.words.track_lines import neighbour_lines
from rsoconsole.control import (
    Status,
    neighbours_and_missing_words,
    read_status,
    sort_by_separation,
    status_json,
)
from rsoconsole.night import Night
from tests.nights import eight_tracks as eight
from tests.nights.made_up_night import t_of
from tests.nights.pair_records import expected_of, pair_of, pairs_of, unseen_of

AT_80_X_24 = (35, 17)


def night_with_pairs(*unseen, **closest) -> Night:
    night = eight.night_of_eight()
    pairs = [
        pair_of(12, one, other, **(closest if (one, other) == (1, 2) else {}))
        for one in range(1, 9)
        for other in range(one + 1, 9)
    ]
    night.fold_record(t_of(12), pairs_of(12, *pairs))
    night.fold_record(t_of(12), expected_of(12, *unseen))
    return night


def words(night: Night, size: tuple[int, int] = AT_80_X_24, chosen: int | None = None) -> list[str]:
    lines = neighbour_lines(night.view(), chosen, *size)
    assert len(lines) <= size[1]
    said = ["".join(text for text, _ in line) for line in lines]
    assert all(len(each) <= size[0] for each in said)
    return said


def test_each_of_eight_tracks_has_its_nearest_neighbour_in_the_narrowest_column():
    said = words(night_with_pairs(unseen_of()))
    assert said[1].split() == ["#", "by", "apart", "/min", "least", "at", "UT"]
    rows = [line[1:].split() for line in said[2:10]]
    assert [row[0] for row in rows] == ["1", "2*", "3", "4", "5", "6", "7", "8"]
    assert rows[0][1:4] == ["2", "4.2′", "-1.44"]
    assert rows[0][4] == "61.0″"
    assert rows[7][1] == "7"  # the way from 7 to 8 is the way from 8 to 7
    below = " ".join(said[10:])
    assert "2* to 1 ASTRA 1KR" in below
    assert "253.2 ± 0.5″" in below
    assert "least 52 to 73″" in below


def test_where_there_is_room_the_missing_are_told_with_their_place_and_why():
    dark, cut = unseen_of("ASTRA 2C", is_lit=False), unseen_of("KAZSAT", is_usable=False)
    unseen = (unseen_of(), dark, cut)
    said = " ".join(words(night_with_pairs(*unseen), (100, 30)))
    assert "expected, not seen: ASTRA 1H x 3120 y 912" in said
    assert "ASTRA 2C x 3120 y 912 in shadow" in said
    assert "KAZSAT x 3120 y 912 at the edge" in said


def test_a_track_that_no_catalogued_object_explains_is_named_so():
    night = night_with_pairs()
    unknown = replace(eight.name_of(12, 4, ""), verdict="unknown", matches=())
    night.fold_record(t_of(12), unknown)
    assert "not in the catalogue: track 4" in " ".join(words(night, (100, 30)))
    from rsoconsole.console.words.track_lines import track_name_words

    assert track_name_words(night.view(), 4) == "not in catalogue"


def test_two_that_part_and_two_that_still_near_have_no_instant():
    parting = words(night_with_pairs(closest="now"))
    assert parting[2].rstrip().endswith("now")
    assert "they part" in " ".join(parting[10:])
    nearing = words(night_with_pairs(closest="beyond"))
    assert nearing[2].rstrip().endswith("later")


def test_pairs_of_ended_tracks_are_gone_and_one_alone_has_no_neighbour():
    night = Night(eight.Path("one"), {}, None)
    for n in (1, 2):
        for record in eight.story(n, since=1, tracks=(1,), lead=1):
            night.fold_record(t_of(n), record)
    night.fold_record(t_of(2), pairs_of(2, pair_of(2, 1, 2)))
    assert "no two are followed" in words(night)[1]


def test_status_has_pairs_and_the_missing_over_the_wire_and_in_plain_lines():
    pairs = [pair_of(12, one, other) for one in (1, 2, 3) for other in range(one + 1, 4)]
    close = replace(pairs[0], is_close=True)
    dark = unseen_of("ASTRA 2C", is_lit=False)
    told = Status(
        pairs=sort_by_separation([*pairs[1:], close]),
        unseen=(unseen_of(), dark),
        uncatalogued=(3,),
    )
    there = read_status(json.loads(json.dumps(status_json(told))))
    assert there.pairs == told.pairs
    assert there.unseen == told.unseen
    assert there.uncatalogued == (3,)
    said = neighbours_and_missing_words(there.pairs, there.unseen, there.uncatalogued)
    assert all(len(each) <= 80 for each in said)
    assert said[0].startswith("2-3: 253.2 ± 0.5″ -1.44 ± 0.03″/min, least 52 to 73″")
    assert any(each.startswith("1-2:") and each.endswith("!") for each in said)
    assert not any(each.startswith("1-3:") for each in said)  # neither is the other's nearest
    assert "not in the catalogue: track 3" in said
    assert said[-1] == "expected, not seen: ASTRA 2C (25785) x 3120 y 912 in shadow"
    assert neighbours_and_missing_words((), (), ()) == []
