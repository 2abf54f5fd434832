"""The one reader of sessions."""
