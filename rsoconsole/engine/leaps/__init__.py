"""Stares where low satellites come by, and leaps ahead of them."""
