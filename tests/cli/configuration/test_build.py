"""Only our own classes and torch's optimisers are built, and their keys are checked."""

from __future__ import annotations

import sys

import pytest

from aerial_il.cli.configuration.build import build, locate
from aerial_il.core.errors import InvalidValueError, UnknownNameError

FIELD = "aerial_il.core.specs.Field"


def test_values_become_arguments() -> None:
    field = build({"_target_": FIELD, "name": "pos", "shape": [3]})
    assert (field.name, field.shape, field.group) == ("pos", [3], "proprio")


def test_nested_targets_are_built_first() -> None:
    spec = build(
        {"_target_": "aerial_il.core.specs.ObservationSpec", "fields": [{"_target_": FIELD, "name": "a", "shape": []}]}
    )
    assert spec.names == ("a",)


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "subprocess.run",
        "aerial_ilx.evil",
        "torch.load",
        "torch.hub.load",
        "aerial_il",
        "builtins.eval",
    ],
)
def test_foreign_targets_are_refused(target: str) -> None:
    with pytest.raises(InvalidValueError, match=r"refused: only aerial_il\.\* and torch\.optim\.\*"):
        build({"_target_": target})


def test_a_foreign_target_is_refused_before_anything_is_imported(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trap_module.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    inner = {"_target_": FIELD, "name": {"_target_": "trap_module.run"}, "shape": []}
    with pytest.raises(InvalidValueError, match="refused"):
        build(inner)
    assert "trap_module" not in sys.modules


@pytest.mark.parametrize("target", ["aerial_il.core.provenance.subprocess", "aerial_il.core.files.Path", FIELD + "X"])
def test_what_our_modules_merely_import_cannot_be_reached_through_them(target: str) -> None:
    with pytest.raises(InvalidValueError, match=r"is not|does not exist"):
        locate(target)


def test_an_unknown_key_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'shape'"):
        build({"_target_": FIELD, "name": "a", "shpe": []})
