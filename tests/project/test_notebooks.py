"""Notebooks show what their sources do: executed, in step with them, and told in other languages with the same code."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import jupytext
import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "notebooks").glob("*.py"))
TRANSLATED = sorted((ROOT / "notebooks").glob("*/*.py"))
EXECUTED = sorted((ROOT / "notebooks").rglob("*.ipynb"))
LARGEST = 1_000_000  # bytes of one
PLACES = re.compile(r"/(?:home|root|work|tmp|Users)/")  # of a machine, which nobody else has


def builder() -> ModuleType:
    """Return setup/notebooks.py as a module."""
    spec = importlib.util.spec_from_file_location("notebooks", ROOT / "setup" / "notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def name(path: Path) -> str:
    return str(path.relative_to(ROOT / "notebooks").with_suffix(""))


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES, ids=name)
def test_it_runs_from_top_to_bottom_and_shows_something(source: Path, tmp_path: Path) -> None:
    assert builder().outputs_of(builder().execute(source, tmp_path))


@pytest.mark.parametrize("made", EXECUTED, ids=name)
def test_what_is_shown_is_of_the_source_as_it_is(made: Path) -> None:
    assert builder().in_step(made.with_suffix(".py")), "make notebooks"
    text = made.read_text()
    assert len(text) < LARGEST
    assert not PLACES.search("".join(str(output) for output in builder().outputs_of(nbformat.reads(text, 4))))


@pytest.mark.parametrize("source", TRANSLATED, ids=name)
def test_a_translation_has_the_same_code(source: Path) -> None:
    english, told = (jupytext.read(path) for path in (source.parent.parent / source.name, source))
    assert builder().code_of(english) == builder().code_of(told)
    assert [cell.cell_type for cell in english.cells] == [cell.cell_type for cell in told.cells]


SMALL = "# %% [markdown]\n# # A sum\n\n# %%\nprint(1 + 1)\n"


@pytest.mark.parametrize("change", ["code", "text", "error", "nothing shown"])
def test_what_is_out_of_step_is_found(change: str, tmp_path: Path) -> None:
    house, source = builder(), tmp_path / "01_sum.py"
    source.write_text(SMALL)
    notebook = jupytext.read(source)
    notebook.cells[1].outputs = [nbformat.v4.new_output("stream", text="2\n")]
    house.write(notebook, source.with_suffix(".ipynb"))
    assert house.in_step(source)
    if change == "code":
        source.write_text(SMALL.replace("1 + 1", "1 + 2"))
    elif change == "text":
        source.write_text(SMALL.replace("A sum", "A product"))
    else:
        kinds = {"error": [nbformat.v4.new_output("error", ename="E", evalue="", traceback=[])], "nothing shown": []}
        notebook.cells[1].outputs = kinds[change]
        house.write(notebook, source.with_suffix(".ipynb"))
    assert not house.in_step(source)


def test_another_language_has_outputs_of_the_same_code(tmp_path: Path) -> None:
    house, source, other = builder(), tmp_path / "01_sum.py", tmp_path / "other.py"
    source.write_text(SMALL)
    executed = jupytext.read(source)
    executed.cells[1].outputs = [nbformat.v4.new_output("stream", text="2\n")]
    other.write_text(SMALL.replace("A sum", "一个和"))
    told = house.with_outputs(other, executed)
    assert (told.cells[0].source, told.cells[1].outputs) == ("# 一个和", executed.cells[1].outputs)
    other.write_text(SMALL.replace("1 + 1", "2"))
    with pytest.raises(SystemExit, match="only the text may"):
        house.with_outputs(other, executed)
