"""Tests; `CONTRIBUTING.md` says how they are run."""

import os

# As the program does for itself: small matrices are no quicker on all cores, and cost them all.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
