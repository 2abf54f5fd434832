"""Records of leaps as a night has them."""

from rsoconsole.records import LeapDone, LowPass
from tests.makers import NS, T0_UTC_NS


def leap_of(n: int, **others) -> LeapDone:
    """The n-th after the streak of frame 3, met 2.5 arcsec ahead of where it was to be."""
    fields = {
        "frame_id": 3 + n,
        "begun_frame_id": 3,
        "number": n,
        "result": "met",
        "t_order_utc_ns": T0_UTC_NS + n * 5 * NS,
        "ordered": "at close" if n > 3 else "by the frame",
        "t_mid_utc_ns": T0_UTC_NS + n * 5 * NS + 4 * NS,
        "ra_icrs_deg": 120.0 + n,
        "dec_icrs_deg": -5.0,
        "speed_arcsec_s": 1500.0,
        "sigma_along_arcsec": 12.0,
        "sigma_across_arcsec": 1.5,
        "within": 0.99,
        "flips": n == 4,
        "exposure_s": 0.2,
        "binning": 2,
        "off_along_arcsec": 2.5,
        "off_across_arcsec": -0.5,
        "total_s": 5.0,
        "slew_s": 2.25,
        "settle_s": 2.0,
        "shutter_s": 0.25,
        "open_s": 0.25,
        "readout_s": 0.0,
        "wait_s": 0.25,
        "subframe": 1.0,
    }
    return LeapDone(**{**fields, **others})


def pass_of(**others) -> LowPass:
    """Of five streaks, with an orbit at 550 km."""
    fields = {
        "frame_id": 8,
        "begun_frame_id": 3,
        "name": "",
        "ended": "it sets",
        "streaks": 5,
        "planned_leaps": 6,
        "t_first_utc_ns": T0_UTC_NS,
        "t_last_utc_ns": T0_UTC_NS + 29 * NS,
        "probability": 1.0,
        "epoch_utc_ns": T0_UTC_NS + 15 * NS,
        "r_gcrs_km": (6900.0, 100.0, 50.0),
        "v_gcrs_km_s": (0.1, 7.0, 2.5),
        "covariance": tuple(
            tuple(0.25 if row == column else 0.0 for column in range(6)) for row in range(6)
        ),
        "a_km": 6928.5,
        "e": 0.0015,
        "i_deg": 53.0,
        "believes_round": True,
        "along_rms_arcsec": 1.25,
        "across_rms_arcsec": 0.75,
        "t_next_rise_utc_ns": T0_UTC_NS + 5_400 * NS,
        "sigma_next_s": 3.5,
        "sigma_next_across_deg": 0.02,
        "scatter_s": 0.125,
    }
    return LowPass(**{**fields, **others})
