"""The site in force for recorded frames: the configured one, else the one in their headers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rsoconsole.base import FrameError
from rsoconsole.config import Config, SiteConfig
from rsoconsole.instruments import (
    SAME_PLACE_KM,
    HeaderSite,
    header_site,
    read_frame,
    site_words,
)
from rsoconsole.records import Frame, Site
from rsoconsole.sky import ground_distance_km

_MAX_READ = 5
"""Number of frames that are read for a site before all of them are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSite:
    """A configuration with the site in force, and where that is from."""

    config: Config
    source: Literal["configuration", "header", "default"]
    words: str = ""
    """Cards of the header that state it; of a default, why those of the headers are not used."""
    frame: str = ""
    """Name of the frame whose header states it."""

    @property
    def site(self) -> Site:
        """The site in force."""
        return self.config.site.to_site()

    @property
    def report(self) -> dict[str, Any]:
        """The site as a JSON object."""
        site = self.site
        return {
            "latitude_deg": site.latitude_deg,
            "longitude_deg": site.longitude_deg,
            "elevation_m": site.elevation_m,
            "source": self.source,
        }

    def notes(self, frame: Frame) -> tuple[str, ...]:
        """Return sentences on the site that a frame's header states."""
        stated = header_site(frame.header)
        return (*stated.notes, *self._compared(stated))

    def _compared(self, stated: HeaderSite) -> Iterator[str]:
        if self.source == "header":
            whose = f" of {self.frame}" if stated.site is None else ""
            yield (
                f"the site is {site_words(self.site)} by {self.words} of the header{whose}: the"
                " configuration sets none"
            )
        if stated.site is None or self.source == "default":
            return
        apart_km = ground_distance_km(self.site, stated.site)
        if apart_km > SAME_PLACE_KM:
            whose = "configured" if self.source == "configuration" else "first frame's"
            yield (
                f"the header's site {site_words(stated.site)} is {apart_km:.0f} km from the"
                f" {whose} {site_words(self.site)}, which is used"
            )


def site_of_frames(
    paths: Sequence[Path], config: Config, *, extension: str | None = None
) -> FrameSite:
    """Return the site in force for frames.

    Where the configuration sets none it is the first in the headers of the first ``_MAX_READ``
    frames; where these have none either, the default stays.
    """
    if config.site.is_set:
        return FrameSite(config=config, source="configuration")
    reasons: tuple[str, ...] = ()
    for path in paths[:_MAX_READ]:
        try:
            frame = read_frame(path, 1, extension=extension)
        except FrameError:
            continue
        stated = header_site(frame.header)
        if stated.site is None:
            reasons = reasons or stated.notes
            continue
        site = SiteConfig(
            name="of the frames",
            latitude_deg=stated.site.latitude_deg,
            longitude_deg=stated.site.longitude_deg,
            elevation_m=stated.site.elevation_m,
        )
        return FrameSite(
            config=config.model_copy(update={"site": site}),
            source="header",
            words=stated.words,
            frame=path.name,
        )
    return FrameSite(config=config, source="default", words="; ".join(reasons))
