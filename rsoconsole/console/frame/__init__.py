"""One frame at full resolution: any pixel of it, and what other settings would say."""
