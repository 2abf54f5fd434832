"""The screens: the live night, and review of a recorded one."""
