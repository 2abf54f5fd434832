"""The nights of these tests begin when those of the engine do: they share what is worked out."""

from tests.rigs.kept_sun import kept_sun

__all__ = ["kept_sun"]  # a fixture of every test
