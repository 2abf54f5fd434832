"""Threads that read, ask and compute for the screens."""
