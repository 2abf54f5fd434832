"""The machine itself: its heat, time, disk and name, and the engine's messages to systemd."""
