"""The demo: a simulated observatory with the real program behind it, and the bench."""
