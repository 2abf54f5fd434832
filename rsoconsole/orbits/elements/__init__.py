"""Element sets: read, checked, propagated by SGP4, and fitted to an orbit that was found."""
