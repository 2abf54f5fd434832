"""The doctor's look at the shutter: whether it was calibrated, and how long ago."""

from datetime import date

from rsoconsole.config import Config
from rsoconsole.engine.doctor.doctor_check import Check, unsure
from rsoconsole.instruments.observatory import utc_now_ns
from rsoconsole.sky import day_of
from rsoconsole.words import OLD_DAYS, age_days, mode_words, shutter_words, timing_words

HOW = "'rsoconsole calibrate-time NIGHT --rinex FILE --write', of nights on navigation satellites"


def check_shutter(config: Config, today: date | None = None) -> Check:
    """Every camera mode's timing with its age; unknown where nothing was measured."""
    today = today or day_of(utc_now_ns())
    known = config.exposure.calibrated
    if not known:
        return unsure(shutter_words(config.exposure, today), HOW)
    detail = "; ".join(f"{mode_words(each.mode)}: {timing_words(each, today)}" for each in known)
    old = [each for each in known if age_days(each, today) > OLD_DAYS]
    later = [each for each in known if age_days(each, today) < 0]
    if later:
        remedy = "the machine's clock is wrong, or exposure.calibrated.measured_on"
    else:
        remedy = f"older than {OLD_DAYS} days: measure again, {HOW}" if old else ""
    return Check(ok=None if old or later else True, detail=detail, remedy=remedy)
