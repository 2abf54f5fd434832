"""A streak is called by what it is, on every screen and in ``detect`` alike."""

from rsoconsole.cli.words.frame_words import detect_lines
from rsoconsole.console.picture.marks import streak_mark
from rsoconsole.night import line_of
from rsoconsole.pipeline import detections_report
from rsoconsole.records import Detection, Detections
from rsoconsole.words import notable_streaks_words, streak_name, streak_pulse_words
from tests.makers import straight_detection

PLAIN = straight_detection(object_class="satellite", class_probability=0.97)
LIGHTS = straight_detection(
    kind="crossing",
    object_class="aircraft",
    class_probability=0.83,
    modulation_period_px=14.25,
    modulation_depth=0.7,
)
TRAIN = straight_detection(kind="clipped", train=5)
OPEN = straight_detection()


def found(*streaks: Detection) -> Detections:
    return Detections(frame_id=7, width_px=900, height_px=700, detections=streaks)


def test_a_streak_is_called_by_what_is_known_of_it():
    assert streak_name(LIGHTS) == "crossing, aircraft 0.83"
    assert streak_name(PLAIN) == "satellite 0.97"
    assert streak_name(TRAIN) == "clipped, train of 5"
    assert streak_name(OPEN) == ""
    assert streak_pulse_words(LIGHTS) == "pulses every 14.2 px, depth 0.70"
    assert streak_pulse_words(OPEN) == ""


def test_detect_says_it_in_words_and_in_json():
    report = detections_report("a.fits", found(PLAIN, LIGHTS, OPEN))
    keys = ("kind", "class", "class_probability", "train", "modulation_period_px")
    assert [tuple(each[key] for key in keys) for each in report["detections"]] == [
        ("streak", "satellite", 0.97, 0, None),
        ("crossing", "aircraft", 0.83, 0, 14.25),
        ("streak", "undetermined", 1.0, 0, None),
    ]
    assert report["detections"][1]["modulation_period_s"] is None
    assert [each["clipped"] for each in report["detections"]] == [False, True, False]
    _, first, second, third = detect_lines(report)
    assert first.endswith(", satellite 0.97")
    assert second.endswith(", crossing, aircraft 0.83, pulses every 14.2 px, depth 0.70")
    assert third.endswith("SNR 60")


def test_the_log_names_what_no_track_begins_with_and_nothing_else():
    line = line_of(found(PLAIN, LIGHTS, TRAIN, LIGHTS), 1)
    assert line is not None
    assert line.text == "detected: 2 x crossing, aircraft 0.83; clipped, train of 5"
    assert line_of(found(PLAIN, OPEN, straight_detection(is_clipped=True)), 1) is None
    assert notable_streaks_words([]) == ""


def test_the_picture_says_it_beside_the_confidence():
    assert streak_mark(LIGHTS, "candidate").label == ".90 aircraft"
    assert streak_mark(TRAIN, "candidate").label == ".90 clipped"
    assert streak_mark(OPEN, "candidate").label == ".90"
