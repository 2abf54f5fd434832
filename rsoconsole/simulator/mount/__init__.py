"""Model of a German equatorial mount, with the faults of its driver."""
