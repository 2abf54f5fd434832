"""One cycle, frame to command, as the engine, `process`, what-if and batch all run it."""
