"""Leaps to low satellites: where and when to meet them next, and how long a slew takes. Pure."""
