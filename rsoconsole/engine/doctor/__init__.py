"""Is this machine ready for a night: one check for each thing that has ended nights before."""
