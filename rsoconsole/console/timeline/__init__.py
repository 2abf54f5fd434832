"""The time line of a night: moments, signs, and the moves through them."""
