"""What-if settings of a night: figures, comparison, presets."""
