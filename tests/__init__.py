"""Tests; `CONTRIBUTING.md` says how they are run."""

import os
import sys

# As the program does for itself: small matrices are no quicker on all cores, and cost them all.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What was compiled is kept: a program that a test starts does not compile the whole of it again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
