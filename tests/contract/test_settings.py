"""An algorithm's and a policy's file states every setting that it has, and stands on at most two classes of ours."""

from __future__ import annotations

from dataclasses import MISSING, fields

import pytest

from aerial_il.core import registry
from aerial_il.core.schema import keys

ALL = [(kind, name) for kind in ("algorithm", "policy") for name in registry.names(kind)]
each = pytest.mark.parametrize(("kind", "name"), ALL)


@each
def test_a_file_states_all_its_settings(kind: str, name: str) -> None:
    settings = registry.get(kind, name)
    stated = vars(settings)["__annotations__"]
    assert [field.name for field in fields(settings) if field.name not in stated] == []
    lacking = [f.name for f in fields(settings) if f.default is MISSING and f.default_factory is MISSING]
    assert lacking == [], "each has a default"
    assert settings.__name__.lower() == name.replace("_", ""), "called as its file"


@each
def test_it_stands_on_two_classes_at_most(kind: str, name: str) -> None:
    ours = [cls for cls in registry.get(kind, name).__mro__[1:] if cls.__module__.startswith("aerial_il.")]
    assert len(ours) <= 2


@each
def test_every_setting_has_a_meaning(kind: str, name: str) -> None:
    assert [key.name for key in keys(registry.get(kind, name)) if not key.meaning] == []
