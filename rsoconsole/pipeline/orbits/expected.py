"""Records of catalogued objects that should be in a frame and are not tracked."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsoconsole.config import CatalogueConfig, Config
from rsoconsole.orbits import (
    ASSUMED,
    ERROR_REGIMES,
    CatalogueEntry,
    ElementErrors,
    ErrorFactors,
    Regime,
    covariance_rtn,
    manoeuvred_probability,
    nearest_epoch_entries,
    object_places,
    orbit_regime,
    states_gcrs,
)
from rsoconsole.pipeline.frame.measurement import mid_exposure_utc_ns
from rsoconsole.records import (
    Event,
    ExpectedMembers,
    FrameTaken,
    Identified,
    Miss,
    Missed,
    Record,
    Site,
    Solution,
    TrackState,
    UnseenMember,
)
from rsoconsole.sky import (
    ARCSEC_RAD,
    LIT_SHARE,
    lit_fraction,
    pixel_to_sky,
    separation_deg,
    site_gcrs,
    sky_to_pixel,
)
from rsoconsole.tracking import direction_icrs_deg
from rsoconsole.words import NS_PER_DAY, catalogued_name, unseen_words

_TIMES = 3.0


def catalogue_errors(catalogue: CatalogueConfig) -> ElementErrors:
    """Return the errors of elements: assumed, and scaled by measured factors where configured."""
    return ASSUMED.scaled(element_error_factors(catalogue))


def wide_element_errors(catalogue: CatalogueConfig) -> ElementErrors:
    """Return wide errors of elements, to identify tracks from which the errors are measured.

    They are the larger of 3 times the assumed and 2 times the measured errors. Narrow ones would
    select tracks with small differences, and give errors that are too small.
    """
    known = element_error_factors(catalogue)
    wide = {}
    for regime in ERROR_REGIMES:
        each = known.get(regime, ErrorFactors())
        wide[regime] = ErrorFactors(
            along_at_epoch=max(2.0 * each.along_at_epoch, _TIMES),
            along_by_age=max(2.0 * each.along_by_age, _TIMES),
            across=max(2.0 * each.across, _TIMES),
        )
    return ASSUMED.scaled(wide)


def element_error_factors(catalogue: CatalogueConfig) -> dict[Regime, ErrorFactors]:
    """Return the configured factors on the assumed element errors, by kind of orbit."""
    return {
        each.regime: ErrorFactors(
            along_at_epoch=each.along_at_epoch, along_by_age=each.along_by_age, across=each.across
        )
        for each in catalogue.error_factors
    }


def errors_report(catalogue: CatalogueConfig) -> list[dict[str, Any]]:
    """Return, for JSON, whether the element errors of each kind of orbit are measured."""
    measured = {each.regime: each for each in catalogue.error_factors}
    return [
        {
            "regime": regime,
            "source": "assumed" if (each := measured.get(regime)) is None else "measured",
            "tracks": 0 if each is None else each.tracks,
            "objects": 0 if each is None else each.objects,
            "oldest_days": None if each is None else each.oldest_days,
            "measured_on": None if each is None else each.measured_on.isoformat(),
        }
        for regime in ERROR_REGIMES
    ]


EVERY = 4
"""Number of frames between two comparisons with the catalogue; larger for long catalogues."""
_SETS_A_FRAME = 500
"""Element sets for each frame of that interval, in longer catalogues."""
_EDGE_DEG = 0.3
"""Margin about the frame: the shift by light time and aberration, and more."""
_MAY_BE = 0.05
"""Probability from which a track may be of an object."""
_SAID_AFTER = 3
"""Number of comparisons in a row without an object after which that is reported."""
_KEPT_NS = 6 * 3_600_000_000_000
"""Time for which the sets nearest in epoch stay the same."""

Entries = Callable[[], Sequence[CatalogueEntry]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SolvedFrame:
    """Solved frame with its mid-exposure."""

    taken: FrameTaken
    solution: Solution
    t_utc_ns: int
    """Mid-exposure."""


class UntrackedObjects:
    """Finds catalogued objects that should be in the frame and are not tracked, from records."""

    def __init__(self, config: Config, entries: Entries) -> None:
        """``entries``: returns the element sets; raises OrbitError where they cannot be read."""
        self._config = config
        self._entries = entries
        self._sets: tuple[CatalogueEntry, ...] = ()
        self._sets_utc_ns: int | None = None
        self._taken: FrameTaken | None = None
        self._solution: Solution | None = None
        self._tracks: dict[int, TrackState] = {}
        self._names: dict[int, Identified] = {}
        self._frames = 0
        """Number of solved frames since the last comparison."""
        self._missing: dict[int, int] = {}
        """Number of comparisons in a row without the object, by catalogue number."""
        self.uncatalogued: tuple[int, ...] = ()
        """Tracks of the last frame that no catalogued object explains; other threads read it."""
        self.last: ExpectedMembers | None = None
        """Result of the last comparison; other threads read it."""

    def configure(self, config: Config, entries: Entries) -> None:
        """Use the settings of ``config`` and these element sets from now on."""
        self._config, self._entries = config, entries
        self._sets, self._sets_utc_ns = (), None

    def receive(self, record: Record) -> None:
        """Process the next record of the log."""
        match record:
            case FrameTaken():
                self._taken, self._solution, self._tracks = record, None, {}
            case Solution():
                self._solution = record
            case TrackState():
                self._tracks[record.track_id] = record
            case Miss(reason=Missed(lost=lost)) if lost is not None:
                self._tracks.pop(record.track_id or 0, None)
            case Identified():
                self._names[record.track_id] = record

    def derive_frame_records(self) -> tuple[Record, ...]:
        """Return the new records after a frame. Raises OrbitError for an unreadable catalogue."""
        self.uncatalogued = tuple(
            n
            for n in sorted(self._tracks)
            if n in self._names and self._names[n].verdict == "unknown"
        )
        taken, solution = self._taken, self._solution
        self._taken = None
        if taken is None or solution is None or solution.frame_id != taken.frame_id:
            return ()
        t_utc_ns = mid_exposure_utc_ns(taken, self._config.exposure)
        if t_utc_ns is None:
            return ()
        self._frames += 1
        if self.last is not None and self._frames < max(EVERY, len(self._sets) // _SETS_A_FRAME):
            return ()
        self._frames = 0
        frame = SolvedFrame(taken=taken, solution=solution, t_utc_ns=t_utc_ns)
        sets = self._sets_at(t_utc_ns)
        return self._look(frame, sets) if sets else ()

    def _sets_at(self, t_utc_ns: int) -> tuple[CatalogueEntry, ...]:
        if self._sets_utc_ns is None or abs(t_utc_ns - self._sets_utc_ns) > _KEPT_NS:
            self._sets = nearest_epoch_entries(self._entries(), t_utc_ns)
            self._sets_utc_ns = t_utc_ns
        return self._sets

    def _look(self, frame: SolvedFrame, sets: Sequence[CatalogueEntry]) -> tuple[Record, ...]:
        errors = catalogue_errors(self._config.catalogue)
        there = catalogued_objects_in_frame(frame, sets, self._config.site.to_site(), errors)
        claimed = self._claimed()
        unnamed = [
            direction_icrs_deg(state)
            for number, state in self._tracks.items()
            if number not in self._names
        ]
        gate_deg = self._config.catalogue.gate_deg
        unseen = tuple(
            each
            for each in there
            if each.norad_id not in claimed
            and not any(_may_be(each, direction, gate_deg) for direction in unnamed)
        )
        members = ExpectedMembers(
            frame_id=frame.taken.frame_id,
            t_utc_ns=frame.t_utc_ns,
            compared=len(sets),
            in_frame=len(there),
            unseen=unseen,
        )
        is_news = self.last is None or bool(unseen or self.last.unseen)
        is_news = is_news or (self.last is not None and self.last.in_frame != members.in_frame)
        self.last = members
        words = self._words(members)
        return (members, *words) if is_news else words

    def _claimed(self) -> set[int]:
        """Return the catalogue numbers of objects that a track of the frame is, or may be."""
        found: set[int] = set()
        for number in self._tracks:
            name = self._names.get(number)
            if name is None or name.verdict == "unknown" or not name.matches:
                continue
            found.add(name.matches[0].norad_id)
            if name.verdict == "ambiguous":
                found |= {m.norad_id for m in name.matches if m.probability > _MAY_BE}
        return found

    def _words(self, members: ExpectedMembers) -> tuple[Event, ...]:
        """Report each object once that several comparisons missed where it should be whole."""
        missing = {each.norad_id for each in members.unseen if each.is_usable and each.is_lit}
        for number in [each for each in self._missing if each not in missing]:
            if self._missing[number] < _SAID_AFTER:
                del self._missing[number]
        words: list[Event] = []
        for each in members.unseen:
            if each.norad_id not in missing:
                continue
            looks = self._missing[each.norad_id] = self._missing.get(each.norad_id, 0) + 1
            if looks == _SAID_AFTER:
                name = catalogued_name(each.name, each.norad_id)
                text = f"expected, not seen: {unseen_words(name, each)}"
                words.append(Event(level="info", text=text, frame_id=members.frame_id))
        return tuple(words)


def catalogued_objects_in_frame(
    frame: SolvedFrame, sets: Sequence[CatalogueEntry], site: Site, errors: ElementErrors = ASSUMED
) -> tuple[UnseenMember, ...]:
    """Return the catalogued objects that should be in a frame, the nearest to its middle first."""
    taken, wcs = frame.taken, frame.solution.wcs
    width, height = taken.width_px, taken.height_px
    centre = ((width - 1) / 2.0, (height - 1) / 2.0)
    corners = pixel_to_sky(wcs, np.array([centre[0], -0.5]), np.array([centre[1], -0.5]))
    ra_deg, dec_deg = (np.asarray(each, float) for each in corners)
    radius_deg = float(separation_deg(ra_deg[0], dec_deg[0], ra_deg[1], dec_deg[1])) + _EDGE_DEG
    near = _within(sets, site, frame.t_utc_ns, (float(ra_deg[0]), float(dec_deg[0])), radius_deg)
    found = [_member(each, frame, site, errors) for each in near]
    inside = [
        each
        for each in found
        if each is not None and 0 <= each.x_px <= width - 1 and 0 <= each.y_px <= height - 1
    ]
    return tuple(
        sorted(inside, key=lambda each: np.hypot(each.x_px - centre[0], each.y_px - centre[1]))
    )


def _within(
    sets: Sequence[CatalogueEntry],
    site: Site,
    t_utc_ns: int,
    direction_deg: tuple[float, float],
    radius_deg: float,
) -> list[CatalogueEntry]:
    """Return the element sets about a direction; those that SGP4 refuses are left out."""
    t = np.array([t_utc_ns], np.int64)
    line = states_gcrs(sets, t)[0][:, 0] - site_gcrs(site, t)[0]
    ra, dec = np.radians(direction_deg)
    towards = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    cosine = line @ towards / np.linalg.norm(line, axis=-1)
    is_near = cosine > np.cos(np.radians(radius_deg))  # NaN is not
    return [sets[int(n)] for n in np.flatnonzero(is_near)]


def _member(
    entry: CatalogueEntry, frame: SolvedFrame, site: Site, errors: ElementErrors
) -> UnseenMember | None:
    t = np.array([frame.t_utc_ns], np.int64)
    places = object_places(entry, site, t)
    ra_deg, dec_deg = float(places.ra_icrs_deg[0]), float(places.dec_icrs_deg[0])
    half_s = (frame.taken.exposure_s or 0.0) / 2.0
    beside = np.array([-half_s, 0.0, half_s])
    x_px, y_px = sky_to_pixel(
        frame.solution.wcs,
        ra_deg + beside * float(places.ra_rate_deg_s[0]),
        dec_deg + beside * float(places.dec_rate_deg_s[0]),
    )
    if not np.all(np.isfinite([x_px, y_px])):
        return None
    width, height = frame.taken.width_px, frame.taken.height_px
    is_usable = bool(np.all((x_px > 0) & (x_px < width - 1) & (y_px > 0) & (y_px < height - 1)))
    age_days = (frame.t_utc_ns - entry.epoch_utc_ns) / NS_PER_DAY
    off_km = _sigma_km(entry, age_days, errors)
    return UnseenMember(
        norad_id=entry.norad_id,
        name=entry.name,
        ra_icrs_deg=ra_deg % 360.0,
        dec_icrs_deg=dec_deg,
        x_px=round(float(x_px[1]), 1),
        y_px=round(float(y_px[1]), 1),
        sigma_arcsec=round(off_km / float(places.range_km[0]) / ARCSEC_RAD, 1),
        tle_age_days=round(age_days, 2),
        is_usable=is_usable,
        is_lit=bool(lit_fraction(places.position_gcrs_km, t)[0] >= LIT_SHARE),
    )


def _sigma_km(entry: CatalogueEntry, age_days: float, errors: ElementErrors) -> float:
    """Return the sigma of its place along its orbit, with the chance of a manoeuvre."""
    regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
    rate_rad_s = entry.record.no_kozai / 60.0
    kept, moved = (
        covariance_rtn(errors.spread_for(regime, is_moved=is_moved), age_days, rate_rad_s)[1, 1]
        for is_moved in (False, True)
    )
    share = manoeuvred_probability(regime, age_days)
    return float(np.sqrt((1.0 - share) * kept + share * moved))


def _may_be(member: UnseenMember, direction_deg: tuple[float, float], gate_deg: float) -> bool:
    """True where a track without a name yet may be of this object."""
    away_deg = separation_deg(member.ra_icrs_deg, member.dec_icrs_deg, *direction_deg)
    return float(away_deg) <= max(gate_deg, 3.0 * member.sigma_arcsec / 3600.0)
