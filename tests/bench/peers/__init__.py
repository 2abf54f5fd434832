"""The detector's peers, one small module each, and what judges them all by one rule."""
