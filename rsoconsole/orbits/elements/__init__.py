"""Element sets: read, checked, propagated by SGP4, and made of an orbit that was found."""
