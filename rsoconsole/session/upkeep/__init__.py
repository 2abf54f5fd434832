"""Sessions kept well: archived, verified, repaired, recovered, merged, pruned."""
