"""A person's own keys: checked like any mapping, kept in files, read again, and gone on reset."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from aerial_il.core import presets
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop.web.controls import Controls
from tests.teleop.hands import shipped

NAMES = ("keyboard", "gamepad", "touch")


def controls(folder: Path) -> Controls:
    return Controls(partial(presets.read, "device"), NAMES, folder)


def keyboard(**changes: tuple[str, ...]) -> dict[str, dict[str, tuple[str, ...]]]:
    """Return the shipped keyboard with changes, as a page sends it."""
    found: dict[str, tuple[str, ...]] = {}
    for control, command in shipped("keyboard").keys.items():
        found[command] = (*found.get(command, ()), control)
    return {"keyboard": found | changes}


def test_a_change_is_used_kept_and_read_again(tmp_path: Path) -> None:
    bindings = controls(tmp_path).change(keyboard(record=("KeyG",)))
    assert bindings.keys_of("record") == ("KeyG", "pad:Start", "touch:record")
    again = controls(tmp_path)
    assert again.own == ("keyboard",)
    assert again.read()["keyboard"]["record"] == ["KeyG"]
    assert again.read()["gamepad"]["forward"] == "-right_y", "axes of other devices stay"
    assert again.reset() == shipped(*NAMES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("wanted", "error", "words"),
    [
        (keyboard(record=("KeyW",)), InvalidValueError, "KeyW is bound twice"),
        (keyboard(fly=("KeyG",)), UnknownNameError, "fly"),
        (keyboard(record=("KeyÜ",)), UnknownNameError, "KeyÜ"),
        ({"touch": {"record": ("touch:record",)}}, InvalidValueError, "touch"),
    ],
)
def test_what_no_mapping_may_say_is_refused_and_nothing_is_written(tmp_path: Path, wanted, error, words: str) -> None:
    with pytest.raises(error, match=words):
        controls(tmp_path).change(wanted)
    assert not list(tmp_path.iterdir())


def test_without_a_way_to_record_nothing_is_taken(tmp_path: Path) -> None:
    alone = Controls(partial(presets.read, "device"), ("keyboard",), tmp_path)
    with pytest.raises(InvalidValueError, match="record"):
        alone.change(keyboard(record=()))


@pytest.mark.parametrize("content", ["[", "- KeyW\n", "\xff\xfe"])
def test_a_file_that_is_no_mapping_says_how_to_go_on(tmp_path: Path, content: str) -> None:
    (tmp_path / "keyboard.yaml").write_text(content, encoding="latin-1")
    with pytest.raises(InvalidValueError, match="Delete it"):
        controls(tmp_path).read()
