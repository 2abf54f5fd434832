"""Frames drawn by hand, without the product's own renderer."""
