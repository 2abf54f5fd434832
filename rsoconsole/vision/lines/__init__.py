"""Lines of light: proposed by a matched filter, cut out as strips, compared with stars in a row."""
