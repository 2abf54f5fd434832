"""A night along its time: moments, signs, and the way through them."""
