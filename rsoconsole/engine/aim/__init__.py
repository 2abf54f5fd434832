"""Where the telescope goes next, who is in charge, and when the night is dark."""
