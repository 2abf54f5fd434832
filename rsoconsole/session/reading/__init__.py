"""Reading of sessions."""
