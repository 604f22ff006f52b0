"""``aerial-il docs`` writes the pages that the project makes of itself, where it is told to, and says how to look."""

from pathlib import Path

import pytest

from aerial_il.cli.commands.project.docs import show
from aerial_il.presentation.documentation import layers, results
from aerial_il.presentation.documentation.sources import ROOT
from aerial_il.workflows import docs


def test_the_drawing_of_layers_is_that_of_the_contract() -> None:
    published = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
    assert published == layers.drawing(ROOT), "run: aerial-il docs"
    assert all(f">{package}</text>" in published for row in layers.layers(ROOT) for package in row)


def test_the_figure_of_results_is_that_of_the_records() -> None:
    published = (ROOT / "docs" / "results.svg").read_text(encoding="utf-8")
    assert published == results.drawing(ROOT), "run: aerial-il docs"
    assert all(
        f">{task}, {robot}</text>" in published for task in ("reach", "pick_place") for robot in ("fa_hexa_arm4",)
    )


@pytest.mark.parametrize("word", docs.NOWHERE)
def test_nothing_is_no_folder(word: str) -> None:
    assert docs.Docs(out=word, site=word) == docs.Docs(out=None, site=None)


def test_without_a_screen_it_says_how_to_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    show(tmp_path / "index.html")
    assert f"python -m http.server -b 127.0.0.1 -d {tmp_path} 8080" in capsys.readouterr().out
