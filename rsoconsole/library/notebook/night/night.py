"""A session gathered frame by frame, for the figures."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsoconsole.base import SessionError, parse_json
from rsoconsole.config import Config
from rsoconsole.control import one_line
from rsoconsole.night import NightFrame, NightFrames
from rsoconsole.records import Measurement
from rsoconsole.session import SessionReader
from rsoconsole.sky import wrap_180

SAME_FRAME_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnNight:
    """A session's frames in order of time, with its title and configuration."""

    title: str
    frames: tuple[NightFrame, ...]
    config: Config
    firsts: frozenset[str] = frozenset()
    """Ids of measurements that began a track and are drawn as taken by it; empty: none is."""

    def seconds_since_start(self, frame: NightFrame) -> float:
        """Return the seconds from the first frame's mid-exposure to this frame's."""
        return (frame.t_mid_utc_ns - self.frames[0].t_mid_utc_ns) / 1e9

    def taken_measurement(self, frame: NightFrame) -> Measurement | None:
        """Return the frame's measurement to draw as assigned to the lead; None without one."""
        first = (m for m in frame.measurements if m.measurement_id in self.firsts)
        return frame.lead_measured or next(first, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class TruePlace:
    """True place of a simulated satellite at mid-exposure, astrometric ICRS."""

    name: str
    ra_icrs_deg: float
    dec_icrs_deg: float


def make_drawn_night(title: str, config: Config, frames: Iterable[NightFrame]) -> DrawnNight:
    """Make a night of the frames that have a time, in order of time."""
    in_order = sorted((each for each in frames if each.has_time), key=lambda f: f.t_mid_utc_ns)
    return DrawnNight(title=title, frames=tuple(in_order), config=config)


def read_drawn_night(session: Path) -> DrawnNight:
    """Gather a session's frames; those without a time are left out.

    Raises SessionError when the folder is no session or holds no frame with a time.
    """
    reader = SessionReader(session)
    config = reader.config()
    frames = NightFrames(config).fold_all(record for _, _, record in reader.records())
    return expect_frames(
        make_drawn_night(session_title(reader.read_meta(), session), config, frames.kept_frames()),
        session,
    )


def session_title(about: Mapping[str, Any], folder: Path) -> str:
    """Return a session's title, else its folder's name, without control characters.

    ``about``: metadata of the session.
    """
    return one_line(str(about.get("title") or folder.resolve().name))


def expect_frames(night: DrawnNight, session: Path) -> DrawnNight:
    """Return ``night`` unchanged; raise SessionError where it holds no frame with a time."""
    if not night.frames:
        raise SessionError(f"{session} holds no frame with a time: there is nothing to draw")
    return night


def offset_arcsec(
    ra_deg: float, dec_deg: float, from_ra_deg: float, from_dec_deg: float
) -> tuple[float, float]:
    """Return the offset (east, north) of one direction from another, arcsec; safe across RA 0h.

    Valid for small angles.
    """
    cos_dec = math.cos(math.radians(from_dec_deg))
    return wrap_180(ra_deg - from_ra_deg) * cos_dec * 3600.0, (dec_deg - from_dec_deg) * 3600.0


def read_truth(path: Path, night: DrawnNight) -> dict[int, TruePlace]:
    """Read the true places of the observed satellite, by frame number.

    ``path``: truth of a simulated observatory, one JSON object for each exposure. Of several
    satellites, the one nearest to most of the lead's updated states counts as observed. Raises
    SessionError when the file cannot be read as a truth.
    """
    try:
        with path.open(encoding="utf-8") as lines:
            exposures = [parse_json(line) for line in lines if line.strip()]
        by_instant = {
            each["t_start_utc_ns"] / 1e9 + each["exposure_s"] / 2.0: each["satellites"]
            for each in exposures
        }
        places = {
            frame.frame_id: [_place(each) for each in _at(by_instant, frame.t_mid_utc_ns / 1e9)]
            for frame in night.frames
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(f"{path} cannot be read as a simulation's truth: {error}") from error
    name = _followed(night.frames, places)
    return {
        frame_id: each
        for frame_id, satellites in places.items()
        for each in satellites
        if each.name == name
    }


def _at(by_instant: Mapping[float, Any], t_s: float) -> Any:
    nearest = min(by_instant, key=lambda instant: abs(instant - t_s), default=math.inf)
    return by_instant[nearest] if abs(nearest - t_s) < SAME_FRAME_S else ()


def _place(satellite: Mapping[str, Any]) -> TruePlace:
    return TruePlace(
        name=str(satellite["name"]),
        ra_icrs_deg=float(satellite["ra_icrs_deg"]),
        dec_icrs_deg=float(satellite["dec_icrs_deg"]),
    )


def _followed(frames: Iterable[NightFrame], places: Mapping[int, list[TruePlace]]) -> str | None:
    votes: dict[str, int] = {}
    for frame in frames:
        if frame.updated is None or not places[frame.frame_id]:
            continue
        x = frame.updated.x
        nearest = min(
            places[frame.frame_id],
            key=lambda true: math.hypot(
                *offset_arcsec(x[0], x[2], true.ra_icrs_deg, true.dec_icrs_deg)
            ),
        )
        votes[nearest.name] = votes.get(nearest.name, 0) + 1
    return max(votes, key=lambda name: votes[name], default=None)
