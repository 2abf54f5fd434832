"""The machine itself: its heat, time, disk and name, and its messages to systemd."""
