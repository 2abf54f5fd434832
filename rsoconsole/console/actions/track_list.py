"""Which of the tracks is looked at: the list over the plots, and the night as that track saw it."""

from dataclasses import dataclass, replace
from functools import partial

from rsoconsole.console.night import EngineView
from rsoconsole.console.panes import Build
from rsoconsole.console.words import (
    is_chosen,
    name_words,
    neighbour_lines,
    present_utc_ns,
    track_list_lines,
)
from rsoconsole.night import FollowedTrack, FrameRow, NightView


@dataclass(slots=True)
class TrackList:
    """Where the list's cursor is, and what it shows."""

    chosen_id: int | None = None
    """Whose plots are shown, and where the cursor is; None: the lead's."""
    shows_neighbours: bool = False
    """Whether the list says who stands next to whom."""

    def chosen(self, night: NightView) -> FollowedTrack | None:
        """The chosen track; None for the lead, or where it has ended."""
        return next((each for each in night.tracks if each.track_id == self.chosen_id), None)

    def at_cursor(self, night: NightView) -> FollowedTrack | None:
        """The chosen one, or the lead."""
        return self.chosen(night) or lead_of(night)

    def plotted(self, night: NightView) -> NightView:
        """The night with the rows of the chosen track; as it is where that is the lead's."""
        chosen = self.chosen(night)
        return night if chosen is None else night_of(night, chosen)

    def words(self, night: NightView) -> str:
        """Whose the plots are, where they are not the lead's."""
        chosen = self.chosen(night)
        return "" if chosen is None else f"track {chosen.number}"

    def lines(self, night: NightView, engine: EngineView) -> Build:
        """The list, or who stands next to whom."""
        chosen = self.chosen_id if self.chosen(night) is not None else None
        if self.shows_neighbours:
            return partial(neighbour_lines, night, chosen)
        now = present_utc_ns(night, engine)
        return partial(track_list_lines, night, chosen, now, next_aim=engine.next_aim)

    def move(self, night: NightView, by: int) -> None:
        """Move the cursor by a number of rows."""
        tracks = night.tracks
        if not tracks:
            return
        chosen = self.chosen_id if self.chosen(night) is not None else None
        at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
        track = tracks[min(max(at + by, 0), len(tracks) - 1)]
        self.chosen_id = None if track.is_lead else track.track_id


def lead_of(night: NightView) -> FollowedTrack | None:
    """The track that the telescope follows."""
    return next((each for each in night.tracks if each.is_lead), None)


def track_words(night: NightView, track: FollowedTrack) -> str:
    """Its number, and its name where it has one."""
    name = name_words(night, track.track_id)
    return f"track {track.number}{'' if name == '-' else f' ({name})'}"


def night_of(night: NightView, track: FollowedTrack) -> NightView:
    """The night as one of its tracks saw it: what the plots of that track are drawn from."""
    rows = {row.frame_id: row for row in track.rows}
    blank = {"is_followed": False, "residual_arcsec": None, "sigma_arcsec": None, "nis": None}

    def of_track(row: FrameRow) -> FrameRow:
        own = rows.get(row.frame_id)
        if own is None:
            return replace(row, miss=None, **blank)  # type: ignore[arg-type]
        return replace(
            row,
            is_followed=own.is_measured,
            residual_arcsec=own.residual_arcsec,
            sigma_arcsec=own.sigma_arcsec,
            nis=own.nis,
            miss=own.miss,
        )

    return replace(night, track=track.state, rows=tuple(of_track(row) for row in night.rows))
