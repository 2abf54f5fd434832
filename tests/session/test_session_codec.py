"""Records to JSON and back."""

import dataclasses
import json
import types
from collections.abc import Mapping
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.base import SessionError
from rsoconsole.records import (
    DONE,
    Cause,
    Event,
    FrameTaken,
    Miss,
    Missed,
    OperatorAction,
    ParameterChange,
    StateChange,
    TrackState,
    field,
    frames,
    leaps,
    photometry,
    steps,
)
from rsoconsole.session import decode, encode
from rsoconsole.session.log.codec import KINDS

FLOATS = st.floats(allow_nan=False, allow_infinity=False)
INTEGERS = st.integers(-(2**63), 2**63 - 1)
JSON_VALUES = st.recursive(
    st.none() | st.booleans() | INTEGERS | FLOATS | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)
PLAIN = {float: FLOATS, int: INTEGERS, bool: st.booleans(), str: st.text()}
PLAIN |= {type(None): st.none(), Any: JSON_VALUES}


def values_of(hint: Any) -> st.SearchStrategy[Any]:
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in PLAIN:
        return PLAIN[hint]
    if origin in (Literal, Union, types.UnionType):
        return st.one_of(st.just(a) if origin is Literal else values_of(a) for a in arguments)
    if origin is tuple and arguments[1:] != (Ellipsis,):
        return st.tuples(*map(values_of, arguments))
    if origin is tuple:
        return st.lists(values_of(arguments[0]), max_size=3).map(tuple)
    if origin is Mapping:
        return st.dictionaries(st.text(), values_of(arguments[1]), max_size=3)
    assert dataclasses.is_dataclass(hint), hint
    members = get_type_hints(hint)
    kept = [f.name for f in dataclasses.fields(hint) if steps.OFF_RECORD not in f.metadata]
    return st.builds(hint, **{name: values_of(members[name]) for name in kept})


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_record_comes_back_as_it_was_to_the_last_bit(kind: str) -> None:
    @given(values_of(KINDS[kind]))
    def comes_back(record: Any) -> None:
        name, frame_id, body = encode(record)
        again = decode(name, body)
        # repr tells -0.0 from 0.0 and 1 from 1.0, which == does not.
        assert repr(again) == repr(record)
        assert frame_id == getattr(record, "frame_id", None)

    comes_back()


def test_every_record_of_the_loop_can_be_recorded() -> None:
    parts_of_others = {"Site", "Frame", "Detection", "Rejection", "Wcs", "CatalogueMatch"}
    parts_of_others |= {"CameraMode", "Mixture", "LedgerName", "PairMotion", "UnseenMember"}
    parts_of_others |= {"StreakLight", "LightStep"}
    all_records = {
        name
        for module in (steps, frames, field, leaps, photometry)
        for name, thing in vars(module).items()
        if dataclasses.is_dataclass(thing) and thing.__module__ == module.__name__
    }
    assert set(KINDS) == all_records - parts_of_others


def test_numbers_of_numpy_are_recorded_as_plain_ones() -> None:
    state = TrackState(
        track_id=1,
        kind="updated",
        frame_id=3,
        t_utc_ns=np.int64(1_800_000_000_000_000_001),  # type: ignore[arg-type]
        x=(np.float64(0.1), 0.2, 0.3, 0.4),
        P=((np.float64(1e-300), 0.0),),
    )
    _, _, body = encode(state)
    again = decode("TrackState", body)
    assert isinstance(again, TrackState)
    assert again.t_utc_ns == 1_800_000_000_000_000_001
    assert again.x == (0.1, 0.2, 0.3, 0.4)
    assert again.P == ((1e-300, 0.0),)


@pytest.mark.parametrize("broken", [float("nan"), float("inf"), -float("inf"), np.float32("nan")])
def test_what_is_not_finite_is_refused_with_its_place(broken: float) -> None:
    change = ParameterChange(name="detector.tau", before=0.1, after=broken, by="operator")
    with pytest.raises(SessionError, match=r"ParameterChange\.after is (nan|-?inf)"):
        encode(change)
    with pytest.raises(SessionError, match=r"OperatorAction\.arguments\.ra"):
        encode(OperatorAction(verb="slew", arguments={"ra": broken}, outcome=DONE, by="x"))


def test_what_json_cannot_carry_is_refused_with_its_place() -> None:
    action = OperatorAction(verb="slew", arguments={"to": {1, 2}}, outcome=DONE, by="x")
    with pytest.raises(SessionError, match=r"arguments\.to is a set"):
        encode(action)
    with pytest.raises(SessionError, match="64 bits"):
        encode(Miss(frame_id=2**63, reason=Missed(kind="no detection")))
    with pytest.raises(SessionError, match="Site is not a record of a session"):
        encode(frames.Site(latitude_deg=0, longitude_deg=0, elevation_m=0))  # type: ignore[arg-type]


def test_keys_that_are_no_field_are_passed_over() -> None:
    body = json.dumps(
        {"frame_id": 7, "reason": {"kind": "no time", "text": "so"}, "cloud_cover": 0.8}
    )
    assert decode("Miss", body) == Miss(frame_id=7, reason=Missed(kind="no time"))


def test_keys_that_an_earlier_version_lacked_take_their_default() -> None:
    assert decode("Event", '{"level": "info", "text": "dawn"}') == Event(level="info", text="dawn")


@pytest.mark.parametrize(
    ("kind", "body", "says"),
    [
        ("Comet", "{}", "knows no record 'Comet'"),
        ("Miss", "{", "a Miss of this session is damaged"),
        ("Miss", "[]", "damaged"),
        ("Miss", '{"frame_id": 1}', "no reason"),
        ("Miss", '{"frame_id": 1.5, "reason": ""}', "whole number"),
        ("Miss", '{"frame_id": 1, "reason": null}', "text"),
        ("SlewCommand", '{"frame_id": 1, "ra_icrs_deg": NaN}', "damaged"),
        ("Measurement", '{"frame_id": 1, "cov_sky_arcsec2": [1, 2]}', "damaged"),
    ],
)
def test_a_damaged_body_is_an_error_in_words(kind: str, body: str, says: str) -> None:
    with pytest.raises(SessionError, match=says):
        decode(kind, body)


def test_a_pair_that_lost_a_member_is_damaged() -> None:
    _, _, body = encode(
        TrackState(track_id=1, kind="initial", frame_id=1, t_utc_ns=1, x=(1.0, 2.0, 3.0, 4.0), P=())
    )
    with pytest.raises(SessionError, match="damaged"):
        decode("TrackState", body.replace("[1.0,2.0,3.0,4.0]", "[1.0,2.0,3.0]"))


def test_an_absent_value_stays_absent() -> None:
    frame = FrameTaken(
        frame_id=1,
        name="",
        t_start_utc_ns=None,
        exposure_s=None,
        width_px=64,
        height_px=64,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    assert decode(*encode(frame)[::2]) == frame
    change = StateChange(
        frame_id=1, before="SEARCH", after="ACQUIRE", reason=Cause(kind="armed", by="console a@b")
    )
    assert decode(*encode(change)[::2]) == change


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("Miss", {"frame_id": 1, "reason": {"kind": "no kind", "text": "dust"}}),
        (
            "StateChange",
            {
                "frame_id": 1,
                "before": "TRACK",
                "after": "LOST",
                "reason": {"kind": "no kind", "text": "dust", "value": 3.0},
            },
        ),
    ],
)
def test_a_reason_of_no_kind_is_damage_whatever_it_says(kind, fields):
    with pytest.raises(SessionError, match="damaged"):
        decode(kind, json.dumps(fields))
