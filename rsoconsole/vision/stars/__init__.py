"""Stars of a frame: places, widths, and the plate that is fitted to them."""
