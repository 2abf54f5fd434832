"""Upkeep of sessions: archiving, verification, repair, recovery, merging, pruning."""
