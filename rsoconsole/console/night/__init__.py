"""What the console knows of the engine, alerts for changes, and the orbit's prediction."""
