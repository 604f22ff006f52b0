"""The Python reference shows the front and what extensions are made of, and all of it is there."""

from __future__ import annotations

import pytest

from aerial_il.presentation.documentation import modules
from tests.presentation.documentation.public_names import public_names


def test_what_scripts_rely_on_is_shown() -> None:
    front = {"load", "load_batch", "expert", "load_policy", "open_dataset", "collect", "train", "evaluate"}
    assert {f"aerial_il.{name}" for name in front} <= public_names()


def test_what_is_imported_is_not_shown() -> None:
    names = public_names()
    assert "aerial_il.suite.batch.BatchEnvironment" in names
    assert not {"aerial_il.suite.batch.np", "aerial_il.suite.batch.Scenario"} & names


@pytest.mark.parametrize("module", modules.SHOWN)
def test_a_module_has_a_page_and_says_something(module: str) -> None:
    assert f".. automodule:: {module}\n" in modules.pages()[f"python/{module}.rst"]
    assert f"[`{module}`]({module}.rst)" in modules.pages()["python/index.md"]
    assert any(name.startswith(f"{module}.") for name in public_names())
