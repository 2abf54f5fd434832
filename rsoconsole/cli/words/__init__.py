"""What the verbs print: JSON for scripts, lines of at most 80 columns for people."""
