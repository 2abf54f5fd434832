"""The screens: the live night, and the review of a recorded one."""
