"""What all tests of the engine have."""

from tests.rigs.kept_sun import kept_sun

__all__ = ["kept_sun"]
