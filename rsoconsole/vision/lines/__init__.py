"""Lines of light: proposed by a matched filter, turned into strips, told from stars in a row."""
