"""Every notebook runs from top to bottom."""

from __future__ import annotations

from pathlib import Path

import jupytext
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.py"))


FIRST, *LATER = NOTEBOOKS
CASES = [FIRST, *(pytest.param(path, marks=pytest.mark.slow) for path in LATER)]


@pytest.mark.parametrize("path", CASES, ids=[path.stem for path in NOTEBOOKS])
def test_notebook(path: Path) -> None:
    notebook = jupytext.read(path)
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    printed = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs]
    assert printed, "a notebook that shows nothing teaches nothing"
