"""The figures of Jordan et al. (arXiv 2304.06227), drawn from a session."""
