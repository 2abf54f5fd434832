"""Paths of the files shipped with the program, in an installed wheel and in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_SAMPLE = "intelsat-14"


def resource_path(*parts: str) -> Path:
    """Return the path of a file of the package, as ``resource_path("sky", "data", "x.fits")``.

    Raises FileNotFoundError when the installation lacks it.
    """
    path = _PACKAGE.joinpath(*parts)
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing: reinstall rsoconsole")
    return path


def model_file_path(name: str) -> Path:
    """Return the path of a file of the trained network.

    It lies in the wheel, or in ``models/`` of a checkout: an editable install ignores hatch's
    force-include. Raises FileNotFoundError.
    """
    for folder in (_PACKAGE / "_models", _PACKAGE.parent / "models"):
        if (folder / name).exists():
            return folder / name
    raise FileNotFoundError(f"the network {name} is missing: reinstall rsoconsole")


def sample_session_folder() -> Path:
    """Return the folder of the sample session, in the wheel or in ``sessions/`` of a checkout."""
    for folder in (_PACKAGE / "_sessions", _PACKAGE.parent / "sessions"):
        if (folder / _SAMPLE / "session.db").exists():
            return folder / _SAMPLE
    raise FileNotFoundError("the sample session is missing: reinstall rsoconsole")
