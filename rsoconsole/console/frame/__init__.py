"""One frame at full resolution: any pixel of it, and the result of other settings."""
