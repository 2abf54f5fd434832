"""Checks whether this machine is ready for a night; each is for something that once ended one."""
