"""Checks whether this machine is ready for a night; each finds a fault that can end one."""
