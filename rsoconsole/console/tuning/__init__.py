"""Settings on trial for a night: figures with them, a comparison, presets."""
