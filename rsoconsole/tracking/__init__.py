"""Pure: measurements in, tracks out. No input or output, no clock, no threads."""
