"""The machine itself: its heat, time, disk and name, and systemd's word on it."""
