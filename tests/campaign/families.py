"""The families of altered frames, as they are judged: those of the split ``test``."""

from models.altered import FAMILIES, Truth, draw

__all__ = ["FAMILIES", "Truth", "draw"]
