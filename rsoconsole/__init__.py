"""Find and follow satellites that nobody told you about."""

__version__ = "0.1.0"
