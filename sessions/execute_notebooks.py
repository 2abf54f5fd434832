"""Run the notebooks again and keep their outputs, so that they are read without running anything.

    python sessions/execute_notebooks.py [NOTEBOOK...] [--out FOLDER]

Needs rsoconsole[notebook]. Nothing of the machine is kept: no run times, no versions.
"""

import argparse
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent
NOTEBOOKS = ("review.ipynb", "own-frames.ipynb", "orbit-to-name.ipynb")
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
    """Run them, put them in place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebooks", nargs="*", default=NOTEBOOKS, metavar="NOTEBOOK")
    parser.add_argument("--out", type=Path, default=FOLDER)
    options = parser.parse_args()
    for name in options.notebooks:
        target = options.out / Path(name).name
        nbformat.write(execute(FOLDER / Path(name).name, FOLDER), target)
        print(f"{target}: {target.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
