"""Output of the verbs: JSON for scripts, lines of at most 80 columns for people."""
