"""What was in the frames: every line and mover against everything catalogued that crossed."""
