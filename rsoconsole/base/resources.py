"""Paths of the files shipped with the program, in an installed wheel and in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_SAMPLE = "intelsat-14"


def resource(*parts: str) -> Path:
    """Return the path of a file shipped in the package, as ``resource("sky", "data", "x.fits")``.

    Raises FileNotFoundError when the installation lacks it.
    """
    path = _PACKAGE.joinpath(*parts)
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing: reinstall rsoconsole")
    return path


def model_resource(name: str) -> Path:
    """Return the path of a file of the trained network.

    In the wheel, or in ``models/`` of a checkout: hatch's force-include does nothing in an editable
    install.
    """
    for folder in (_PACKAGE / "_models", _PACKAGE.parent / "models"):
        if (folder / name).exists():
            return folder / name
    raise FileNotFoundError(f"the network {name} is missing: reinstall rsoconsole")


def sample_resource() -> Path:
    """Return the folder of the sample session, in the wheel or in ``sessions/`` of a checkout."""
    for folder in (_PACKAGE / "_sessions", _PACKAGE.parent / "sessions"):
        if (folder / _SAMPLE / "session.db").exists():
            return folder / _SAMPLE
    raise FileNotFoundError("the sample session is missing: reinstall rsoconsole")
