"""The command line: verbs that call the packages of lower layers."""

import os

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


def main() -> None:
    """Entry point: set the environment that NumPy and OpenCV read, then run the program."""
    # Vision divides a frame among threads itself; what is left is too small for theirs, which
    # would cost more in waiting for one another than they save. The program's children inherit it.
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    from rsoconsole.cli.app import main as run

    run()


__all__ = ["main"]
