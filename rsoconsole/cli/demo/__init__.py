"""The demo, the real program with a simulated observatory, and the bench of ``doctor``."""
