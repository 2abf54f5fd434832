"""Which element files a session is identified by, where no option names them."""

from collections.abc import Sequence
from pathlib import Path

from rsoconsole.cli.words import output


def element_files(path: Path, configured: Sequence[Path]) -> list[Path]:
    """The configuration's; of a simulated night, or without any, those that the session began with.

    Raises OrbitError with the remedy where there are none.
    """
    from rsoconsole.pipeline.orbits import elements_used

    remedy = "name element sets with --tle FILE, or in catalogue.tle_files of the configuration"
    used = elements_used(path, configured, remedy)
    if used.is_recorded:
        named = ", ".join(map(str, used.files))
        output.complain(f"rsoconsole: by the elements that the session was recorded with: {named}")
    return list(used.files)
