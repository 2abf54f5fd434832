"""The shutter's timing from recorded nights, by streaks of navigation satellites.

Each camera mode is calibrated with all nights together, then with each night alone, because the
offset of the machine's clock may differ from night to night.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rsoconsole.base import OrbitError
from rsoconsole.config import ExposureConfig
from rsoconsole.orbits import (
    MIN_MEASUREMENTS,
    SIGMA_KM,
    Estimate,
    NavigationFile,
    ShutterTiming,
    TimeCalibration,
    TimedDirections,
    calibrate_timing,
    expect_covered,
)
from rsoconsole.pipeline.calibrations._navigation_streaks import (
    MAX_LATE_S,
    NightStreaks,
    Streak,
    header_mid_utc_ns,
    length_and_sigma_arcsec,
    match_satellites,
    read_streaks,
    recompute_offsets,
    satellite_label,
)
from rsoconsole.pipeline.frame.measurement import SAME_EXPOSURE, frame_timing, read_out_mode
from rsoconsole.records import FloatArray
from rsoconsole.sky import ARCSEC_RAD
from rsoconsole.words import NS_PER_DAY, NS_PER_S

_TYPICAL_RANGE_KM = 22_000.0
_ORBIT_KM_S = 3.9
"""Speed of a navigation satellite along its orbit, km/s."""
_EPOCH = date(1970, 1, 1)
_MIN_LENGTHS = 3
"""Fewest streaks of a track whose median length is meaningful."""
_PAUSE_S = 1800
"""Pause after which a satellite begins another track, s: it then stands before other stars."""
_UNLIKELY = 3.0
"""Sigmas of chi squared beyond which nights differ by more than chance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationMode:
    """Camera mode of the frames of a calibration."""

    exposure_s: float | None
    """Exposure, s; None: a pool of several exposures, each too rare to be calibrated alone."""
    read_out: tuple[object, ...]
    """Read-out mode, in the form of ``CalibratedTiming.read_out``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundSatellite:
    """Navigation satellite that was found in the nights."""

    name: str
    streaks: int
    rate_arcsec_s: float
    position_angle_deg: float
    """Position angle of its motion, from north through east."""
    t_utc_ns: int
    norad_id: int | None = None
    """Catalogue number of the satellite's own element set, else of the nearest element set."""
    norad_name: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationNight:
    """Sessions of one night at one site: errors of the star catalogue are common to them."""

    day: date
    """Day on which the night began, at the site."""
    folders: tuple[Path, ...]
    streaks: int
    candidates: int
    clock_offset_s: float | None
    """Offset of the machine's clock, as recorded when the night began; it is part of the bias."""

    @property
    def name(self) -> str:
        """Name of the night in messages: that of its only session, else its date."""
        return self.folders[0].name if len(self.folders) == 1 else f"night of {self.day}"


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundTiming:
    """Calibrated timing of each camera mode, with its nights and satellites."""

    kind: str
    """Kind of the orbits used: broadcast, sp3 or tle."""
    modes: tuple[tuple[CalibrationMode, ShutterTiming | None], ...]
    calibration: TimeCalibration
    nights: tuple[CalibrationNight, ...]
    satellites: tuple[FoundSatellite, ...]
    measured_on: date
    """Day of the last night."""
    simulated: tuple[Path, ...] = ()
    """Sessions of the simulated observatory, whose shutter is not a real camera's."""
    skipped: Mapping[str, int] = field(default_factory=dict)


def calibrate_shutter_timing(
    folders: Sequence[Path], file: NavigationFile, source: str
) -> FoundTiming:
    """Calibrate the shutter of each camera mode from recorded nights.

    ``source``: names of the orbit files, for messages. Raises SessionError for a folder without a
    session, and OrbitError where the file covers another day, or where no or too few streaks are
    those of navigation satellites.
    """
    sessions = [read_streaks(folder, number) for number, folder in enumerate(folders)]
    every = [streak for session in sessions for streak in session.streaks]
    if not every:
        raise OrbitError(
            "these nights hold no streak with both its ends in the frame: expose navigation"
            " satellites for some seconds"
        )
    instants = [header_mid_utc_ns(streak) for streak in every]
    expect_covered(file, instants, source)
    for session in sessions:
        match_satellites(session.streaks, session.config.site.to_site(), file.satellites)
    used = [streak for streak in every if streak.satellite is not None]
    if not used:
        raise OrbitError(
            f"none of {len(every)} streaks is a satellite of {source} within {MAX_LATE_S:g} s of"
            " its place: follow navigation satellites, or look at site and clock"
        )
    exposures = [session.config.exposure for session in sessions]
    modes, number = _modes(used)
    nights = _nights(sessions)
    night_of = {each: k for k, (_, members) in enumerate(nights) for each in members}
    seen, late_s = _about_the_middle(used, number, sessions, night_of)
    lines_s = _configured_line_times(used, number, exposures, len(modes))
    place_arcsec = SIGMA_KM[file.kind] / _TYPICAL_RANGE_KM / ARCSEC_RAD
    found = calibrate_timing(
        seen, modes=len(modes), nights=len(nights), line_time_s=lines_s, place_arcsec=place_arcsec
    )
    if file.kind != "tle":  # whose own errors differ from night to night
        found = _by_night(seen, found, lines_s, place_arcsec)
    moved = tuple(
        timing and _later(timing, float(late_s[mode])) for mode, timing in enumerate(found.modes)
    )
    if file.kind == "tle":
        moved = _as_sure_as_elements(moved, used, number)
    last_ns = max(streak.measurement.t_mid_utc_ns for streak in used)
    return FoundTiming(
        kind=file.kind,
        modes=tuple(zip(modes, moved, strict=True)),
        calibration=found,
        nights=tuple(
            _night(day, [(n, sessions[n]) for n in members], used) for day, members in nights
        ),
        satellites=_satellites(used),
        simulated=tuple(each.folder for each in sessions if each.is_simulated),
        skipped=file.skipped,
        measured_on=datetime.fromtimestamp(last_ns / NS_PER_S, UTC).date(),
    )


def _by_night(
    seen: TimedDirections, found: TimeCalibration, line_time_s: Sequence[float], place_arcsec: float
) -> TimeCalibration:
    """Widen the biases' sigmas by the scatter between nights, where that is more than chance."""
    nights = np.unique(seen.night)
    if len(nights) < 2:
        return found
    alone: dict[int, list[Estimate]] = {}
    for night in nights:
        of_it = seen.subset(seen.night == night)
        of_it = replace(of_it, night=np.zeros_like(of_it.night))
        modes = len(found.modes)
        try:
            calibrated = calibrate_timing(
                of_it, modes=modes, nights=1, line_time_s=line_time_s, place_arcsec=place_arcsec
            )
        except OrbitError:
            continue
        for mode, (timing, whole) in enumerate(zip(calibrated.modes, found.modes, strict=True)):
            if timing is not None and whole is not None:
                alone.setdefault(mode, []).append(_in_row(timing, whole))
    return replace(
        found,
        modes=tuple(
            timing and _widened(timing, alone.get(mode, []))
            for mode, timing in enumerate(found.modes)
        ),
    )


def _in_row(timing: ShutterTiming, whole: ShutterTiming) -> Estimate:
    """Return one night's bias in the row where the bias of all nights is known best."""
    # Nights that differ make one line time of both a wrong one.
    of = timing if timing.is_line_time_found else whole
    rows, line = whole.middle_row_px - timing.middle_row_px, of.line_time_s
    at = timing.bias_at_middle_s
    return replace(
        at,
        value=at.value + rows * line.value,
        sigma=math.hypot(at.sigma, rows * line.sigma if of.is_line_time_found else 0.0),
    )


def _widened(timing: ShutterTiming, nights: Sequence[Estimate]) -> ShutterTiming:
    """Widen the bias by the scatter between nights that their own errors do not explain."""
    if len(nights) < 2:
        return timing
    value = np.array([each.value for each in nights])
    variance = np.array([each.sigma for each in nights]) ** 2
    mean = np.sum(value / variance) / np.sum(1.0 / variance)
    chi2 = float(np.sum((value - mean) ** 2 / variance))
    if chi2 <= len(nights) - 1 + _UNLIKELY * math.sqrt(2.0 * (len(nights) - 1)):
        return timing
    spread_s = float(np.std(value, ddof=1))
    return replace(_less_sure(timing, spread_s), night_spread_s=spread_s)


def _less_sure(timing: ShutterTiming, by_s: float) -> ShutterTiming:
    """Add one more sigma, in quadrature, to that of the bias."""
    return _with_bias(timing, lambda bias: replace(bias, sigma=math.hypot(bias.sigma, by_s)))


def _later(timing: ShutterTiming, late_s: float) -> ShutterTiming:
    """Shift the bias so that it counts from the header's time."""
    return _with_bias(timing, lambda bias: replace(bias, value=bias.value + late_s))


def _with_bias(timing: ShutterTiming, change: Callable[[Estimate], Estimate]) -> ShutterTiming:
    return replace(
        timing, bias_s=change(timing.bias_s), bias_at_middle_s=change(timing.bias_at_middle_s)
    )


def _as_sure_as_elements(
    found: Sequence[ShutterTiming | None], used: Sequence[Streak], number: Sequence[int]
) -> tuple[ShutterTiming | None, ...]:
    """Widen the biases by the error of element sets along their orbits: one error a satellite.

    The scatter of the tracks does not show this error, as the tracks of one satellite share it.
    """
    off_s = SIGMA_KM["tle"] / _ORBIT_KM_S
    seen = [
        Counter(id(streak.satellite) for streak, own in zip(used, number, strict=True) if own == n)
        for n in range(len(found))
    ]
    return tuple(
        timing and _less_sure(timing, off_s / math.sqrt(_as_many_alike(streaks.values())))
        for timing, streaks in zip(found, seen, strict=True)
    )


def _as_many_alike(counts: Collection[int]) -> float:
    """Return the effective number of satellites with these counts of streaks (Kish 1965, 11.7)."""
    return max(sum(counts) ** 2 / max(sum(n * n for n in counts), 1), 1.0)


def _nights(sessions: Sequence[NightStreaks]) -> list[tuple[date, list[int]]]:
    """Return the day on which each night began, and the numbers of its sessions."""
    found: dict[tuple[float, float, int], list[int]] = {}
    for number, session in enumerate(sessions):
        if not session.streaks:
            continue
        site = session.config.site.to_site()
        t = min(header_mid_utc_ns(streak) for streak in session.streaks)
        noons = math.floor(t / NS_PER_DAY + site.longitude_deg / 360.0 - 0.5)
        place = (round(site.latitude_deg, 2), round(site.longitude_deg, 2), noons)
        found.setdefault(place, []).append(number)
    return [(_EPOCH + timedelta(days=day), members) for (_, _, day), members in found.items()]


def _night(
    day: date, sessions: Sequence[tuple[int, NightStreaks]], used: Sequence[Streak]
) -> CalibrationNight:
    numbers = {number for number, _ in sessions}
    offsets = [s.clock_offset_s for _, s in sessions if s.clock_offset_s is not None]
    return CalibrationNight(
        day=day,
        folders=tuple(session.folder for _, session in sessions),
        streaks=sum(streak.session in numbers for streak in used),
        candidates=sum(len(session.streaks) for _, session in sessions),
        clock_offset_s=max(offsets, key=abs) if offsets else None,
    )


def _modes(used: Sequence[Streak]) -> tuple[list[CalibrationMode], list[int]]:
    """Return the modes, and the mode of each streak; rare exposures share one."""
    read_outs = [read_out_mode(streak.taken) for streak in used]
    exposures = [streak.taken.exposure_s or 1.0 for streak in used]
    named: dict[CalibrationMode, int] = {}
    number = [0] * len(used)
    for read_out in dict.fromkeys(read_outs):
        of_it = [n for n, each in enumerate(read_outs) if each == read_out]
        for group in _alike(of_it, exposures):
            usual, _ = Counter(exposures[n] for n in group).most_common(1)[0]
            mode = CalibrationMode(
                exposure_s=usual if len(group) >= MIN_MEASUREMENTS else None, read_out=read_out
            )
            for n in group:
                number[n] = named.setdefault(mode, len(named))
    return list(named), number


def _alike(chosen: Sequence[int], exposures: Sequence[float]) -> Iterator[list[int]]:
    """Groups of exposures that differ by no more than ``SAME_EXPOSURE``."""
    group: list[int] = []
    for n in sorted(chosen, key=lambda k: exposures[k]):
        if group and exposures[n] > SAME_EXPOSURE * exposures[group[0]]:
            yield group
            group = []
        group.append(n)
    yield group


def _configured_line_times(
    used: Sequence[Streak], number: Sequence[int], exposures: Sequence[ExposureConfig], modes: int
) -> list[float]:
    found = [0.0] * modes
    for streak, mode in zip(used, number, strict=True):
        found[mode] = frame_timing(streak.taken, exposures[streak.session]).line_time_us * 1e-6
    return found


def _about_the_middle(
    used: Sequence[Streak],
    number: Sequence[int],
    sessions: Sequence[NightStreaks],
    night_of: Mapping[int, int],
) -> tuple[TimedDirections, FloatArray]:
    """Directions against the orbits at roughly corrected instants, and each mode's delay, s.

    The correction matters because a satellite turns a little in the seconds that a header may be
    off.
    """
    late = np.array(
        [
            float(s.offset_arcsec @ s.rate_arcsec_s) / float(s.rate_arcsec_s @ s.rate_arcsec_s)
            for s in used
        ]
    )
    mode = np.array(number, np.int64)
    late_s = np.array([float(np.median(late[mode == m])) for m in range(int(mode.max()) + 1)])
    track = np.zeros(len(used), np.int64)
    for place, chosen in enumerate(_tracks(used)):
        track[chosen] = place
        site = sessions[used[chosen[0]].session].config.site.to_site()
        recompute_offsets([used[n] for n in chosen], site, late_s[mode[chosen]])
    frames: dict[tuple[int, int], int] = {}
    seen = TimedDirections(
        offset_arcsec=np.array([s.offset_arcsec for s in used]),
        rate_arcsec_s=np.array([s.rate_arcsec_s for s in used]),
        covariance_arcsec2=np.array([s.covariance for s in used]),
        row_px=np.array([s.measurement.y_px for s in used]),
        mode=mode,
        frame=np.array(
            [frames.setdefault((s.session, s.taken.frame_id), len(frames)) for s in used], np.int64
        ),
        track=track,
        length_off_arcsec=_lengths_off(used, track),
        length_sigma_arcsec=np.array([length_and_sigma_arcsec(s)[1] for s in used]),
        is_by_ends=np.array([s.light is None for s in used]),
        tail=np.ones(len(used)),
        night=np.array([night_of[s.session] for s in used], np.int64),
    )
    return seen, late_s


def _lengths_off(used: Sequence[Streak], track: npt.NDArray[np.int64]) -> FloatArray:
    """Return by how much each streak is longer than its track's median, arcsec.

    The median is subtracted because a drifting mount makes all streaks of a track longer or shorter
    than the rate predicts.
    """
    length = np.array([length_and_sigma_arcsec(streak)[0] for streak in used])
    length -= [float(np.hypot(*s.rate_arcsec_s)) * (s.taken.exposure_s or 0.0) for s in used]
    off = np.full(len(used), np.nan)
    for each in np.unique(track):
        of_it = (track == each) & np.isfinite(length)
        count = int(np.sum(of_it))
        if count >= _MIN_LENGTHS:
            apart = length[of_it] - np.median(length[of_it])
            off[of_it] = apart * math.sqrt(count / (count - 1))
    return off


def _tracks(used: Sequence[Streak]) -> Iterator[list[int]]:
    """Yield the tracks: numbers of one satellite's streaks in a session, until a pause."""
    order = sorted(
        range(len(used)),
        key=lambda n: (used[n].session, satellite_label(used[n]), header_mid_utc_ns(used[n])),
    )
    track: list[int] = []
    for n in order:
        if track:
            last = used[track[-1]]
            is_same = (last.session, satellite_label(last)) == (
                used[n].session,
                satellite_label(used[n]),
            )
            if (
                not is_same
                or header_mid_utc_ns(used[n]) - header_mid_utc_ns(last) > _PAUSE_S * NS_PER_S
            ):
                yield track
                track = []
        track.append(n)
    yield track


def _satellites(used: Iterable[Streak]) -> tuple[FoundSatellite, ...]:
    groups: dict[str, list[Streak]] = {}
    for streak in used:
        groups.setdefault(satellite_label(streak), []).append(streak)
    found = []
    for streaks in groups.values():
        east, north = np.mean([s.rate_arcsec_s for s in streaks], axis=0)
        satellite = streaks[0].satellite
        assert satellite is not None
        found.append(
            FoundSatellite(
                name=satellite.name,
                streaks=len(streaks),
                rate_arcsec_s=float(np.hypot(east, north)),
                position_angle_deg=math.degrees(math.atan2(east, north)) % 360.0,
                t_utc_ns=header_mid_utc_ns(streaks[0]),
                norad_id=satellite.norad_id,
            )
        )
    return tuple(sorted(found, key=lambda each: each.name))
