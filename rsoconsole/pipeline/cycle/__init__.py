"""One cycle, frame to records, as the engine and every replay run it."""
