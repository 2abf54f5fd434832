"""What the keys of the seat do: each is one command, or one question."""
