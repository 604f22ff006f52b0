"""Execute the notebooks: notebooks/NN_name.py with its outputs becomes NN_name.ipynb, one after the other.

What is in step with its source is left as it is, so an interrupted `make notebooks` goes on when repeated; `only=05`
chooses by the beginnings of names, `again=1` executes anyway. A notebook in another language (notebooks/zh) has the
code of the English one, so it is given the same outputs.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"
LONGEST_S = 600  # of one cell, on a busy machine
ID = "{stem}-{number:02d}"  # of cells: the same in every making, so that only what changed differs


def code_of(notebook: nbformat.NotebookNode) -> list[str]:
    """Return the text of the code cells."""
    return [cell.source.strip() for cell in notebook.cells if cell.cell_type == "code"]


def outputs_of(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    """Return what all code cells printed and drew."""
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def in_step(source: Path) -> bool:
    """Whether the .ipynb beside ``source`` has its cells, word for word, and shows outputs without an error."""
    made = source.with_suffix(".ipynb")
    if not made.is_file():
        return False
    old, new = nbformat.read(made, as_version=4), jupytext.read(source)
    told = outputs_of(old)
    cells = [[(cell.cell_type, cell.source.strip()) for cell in one.cells] for one in (old, new)]
    return cells[0] == cells[1] and bool(told) and all(output.output_type != "error" for output in told)


def execute(source: Path, folder: Path) -> nbformat.NotebookNode:
    """Run a notebook from top to bottom in ``folder`` and return it with its outputs.

    Raises:
        CellExecutionError: a cell failed; it shows which and how.
    """
    os.environ.update(TQDM_DISABLE="1", OMP_NUM_THREADS="1", PYTHONWARNINGS="ignore")
    notebook = jupytext.read(source)
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=LONGEST_S, kernel_name="python3", resources=resources).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]  # progress, notices
    return notebook


def with_outputs(source: Path, executed: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Return the notebook of ``source`` with the outputs of one that has the same code."""
    notebook = jupytext.read(source)
    if code_of(notebook) != code_of(executed):
        raise SystemExit(f"{source.name}: its code differs from that of the English one; only the text may.")
    ours, theirs = ([c for c in one.cells if c.cell_type == "code"] for one in (notebook, executed))
    for cell, other in zip(ours, theirs, strict=True):
        cell.outputs, cell.execution_count = other.outputs, other.execution_count
    return notebook


def write(notebook: nbformat.NotebookNode, place: Path) -> None:
    """Write the .ipynb, without times and with the same names of cells in every making."""
    for number, cell in enumerate(notebook.cells):
        cell["id"] = ID.format(stem=place.stem, number=number)
        cell.metadata.pop("execution", None)
    notebook.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook.nbformat, notebook.nbformat_minor = 4, 5
    nbformat.write(notebook, place)


def make(source: Path, *, again: bool) -> None:
    """Make the .ipynb of a notebook and of its other languages, where that is not done."""
    others = sorted(NOTEBOOKS.glob(f"*/{source.name}"))
    made = source.with_suffix(".ipynb")
    if again or not in_step(source):
        start = time.monotonic()
        executed = nbformat.read(made, as_version=4) if made.is_file() else None
        if again or executed is None or code_of(executed) != code_of(jupytext.read(source)):
            with tempfile.TemporaryDirectory() as folder:
                executed = execute(source, Path(folder))
        write(with_outputs(source, executed), made)
        print(f"{source.stem}: {time.monotonic() - start:.0f} s, {made.stat().st_size / 1e6:.2f} MB", flush=True)
    for other in others:
        if again or not in_step(other):
            write(with_outputs(other, nbformat.read(made, as_version=4)), other.with_suffix(".ipynb"))


def main() -> None:
    """Make all notebooks, or those whose names begin with what is typed."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("names", nargs="*", help="beginnings of names, e.g. 05; all without")
    parser.add_argument("--again", action="store_true", help="execute those too that are in step")
    asked = parser.parse_args()
    sources = [s for s in sorted(NOTEBOOKS.glob("*.py")) if s.stem.startswith(tuple(asked.names or [""]))]
    if not sources:
        sys.exit(f"No notebook begins with {' or '.join(asked.names)}; see notebooks/README.md.")
    for source in sources:
        make(source, again=asked.again)


if __name__ == "__main__":
    main()
