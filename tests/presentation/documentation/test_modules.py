"""Public names are those that a module defines itself, and each package has a page."""

from __future__ import annotations

import importlib

from aerial_il.presentation.documentation import modules
from aerial_il.presentation.documentation.sources import ROOT


def test_what_is_defined_is_found_and_what_is_imported_is_not() -> None:
    assert {"ActionLevel", "action_spec", "MAX_SPEED"} <= modules.defined("aerial_il.control.actions")
    assert not {"IntEnum", "np", "Vehicle"} & modules.defined("aerial_il.control.actions")


def test_the_front_is_public() -> None:
    front = {"load", "load_batch", "expert", "load_policy", "open_dataset", "collect", "train", "evaluate"}
    assert {f"aerial_il.{name}" for name in front} <= modules.public_names()


def test_what_the_source_names_is_there_when_it_is_imported() -> None:
    for module in ("aerial_il.core.specs", "aerial_il.suite.tasks.reach", "aerial_il.policies.act"):
        found = importlib.import_module(module)
        assert all(hasattr(found, name) for name in modules.defined(module))


def test_every_module_stands_on_a_page() -> None:
    text = "\n".join(modules.pages().values())
    assert all(f".. automodule:: {name}\n" in text for name in modules.modules())


def test_rooms_are_all_named() -> None:
    rooms = {file.parent.name for file in (ROOT / "aerial_il").glob("*/__init__.py")}
    assert rooms == set(modules.ROOMS)
