"""Element sets: read, checked, propagated by SGP4, and fitted to a determined orbit."""
