"""Stars of a frame: where, how wide, and the plate that is fitted to them."""
