"""The elements of the one whose passes are waited for, of the configured files."""

from rsoconsole.config import Config
from rsoconsole.errors import OrbitError
from rsoconsole.orbits.elements import CatalogueEntry
from rsoconsole.pipeline.orbits import read_catalogue


def entry_of(config: Config) -> CatalogueEntry:
    """The newest set. Raises OrbitError where there is none, with the remedy."""
    number, files = config.leap.pass_norad, config.catalogue.tle_files
    if not files:
        raise OrbitError(
            f"no elements of {number}: name element sets in catalogue.tle_files of the"
            " configuration, or with --tle FILE"
        )
    found = [each for each in read_catalogue(files) if each.norad_id == number]
    if not found:
        raise OrbitError(f"no elements of {number} in {', '.join(map(str, files))}")
    return max(found, key=lambda each: each.epoch_utc_ns)
