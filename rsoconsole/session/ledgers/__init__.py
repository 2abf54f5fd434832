"""What is kept across nights: tracks that no catalogue explains, and what elements were off."""
