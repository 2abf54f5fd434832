"""Run review.ipynb again and keep its outputs, so that they can be read without running anything.

    python sessions/execute_review.py [--out FILE]

Needs rsoconsole[notebook]. Nothing of the machine is kept: no run times, no versions.
"""

import argparse
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parent / "review.ipynb"
CELL_S = 120


def execute(source: Path, folder: Path) -> nbformat.NotebookNode:
    """The notebook with its outputs, run in ``folder``. Raises CellExecutionError."""
    notebook = nbformat.read(source, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=CELL_S,
        kernel_name="python3",
        record_timing=False,
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute()
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


def main() -> None:
    """Run it, put it in place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=NOTEBOOK)
    options = parser.parse_args()
    nbformat.write(execute(NOTEBOOK, NOTEBOOK.parent), options.out)
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
