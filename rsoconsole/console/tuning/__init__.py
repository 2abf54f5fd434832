"""Settings tried on a night: figures, verdict, presets."""
