"""What a streak is, and how the frame cuts it, goes on record."""

from dataclasses import replace

from rsoconsole.records import Detection, Detections, NotAStreak, Rejection
from rsoconsole.session import decode, encode
from tests.makers import straight_detection as detection


def found(*streaks: Detection) -> Detections:
    rejected = tuple(Rejection(detection=s, reason=NotAStreak(kind="no line")) for s in streaks)
    return Detections(
        frame_id=1, width_px=1000, height_px=800, detections=streaks, rejected=rejected
    )


def test_what_the_frame_cuts_is_never_called_whole() -> None:
    assert detection(is_clipped=True).kind == "clipped"
    assert detection(is_clipped=True, kind="crossing").kind == "crossing"
    assert detection(kind="crossing").is_clipped
    assert (detection().kind, detection().is_clipped) == ("streak", False)
    assert replace(detection(), is_clipped=True).kind == "clipped"


def test_every_field_comes_back_from_the_record() -> None:
    told = found(
        detection(
            kind="crossing",
            sigma_angle_deg=0.1,
            object_class="aircraft",
            class_probability=0.83,
            modulation_period_px=14.25,
            modulation_period_s=0.5,
            modulation_depth=0.7,
            train=4,
        )
    )
    kind, _, body = encode(told)
    assert decode(kind, body) == told
