"""What a session says of its night: a fold over its records, and what is known of the engine."""
