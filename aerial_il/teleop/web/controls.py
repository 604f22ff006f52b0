"""Keys and buttons as a person wants them: changed on the page, checked like any mapping, kept in files of their own.

A device's own file, ``controls/keyboard.yaml`` by default, is read instead of the shipped one from then on. Its content
is that of ``conf/device/keyboard.yaml``; the mapping that an episode is flown with is in its provenance.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic
from aerial_il.teleop.devices import bindings_of
from aerial_il.teleop.input.mapping import AXIAL, Bindings

CHANGEABLE = ("keyboard", "gamepad")
NEEDED = ("record", "save", "discard", "pause")  # without these, no session
HEAD = "# your own; delete this file for the keys that are shipped\n"

Raw = Mapping[str, Mapping[str, Any]]


class Controls:
    """The mappings of a session's devices, which may be changed while nothing is recorded.

    Args:
        shipped: device -> content of its YAML as shipped, by a device's name. names: devices in use.
        folder: where a person's own files lie.
    """

    def __init__(self, shipped: Callable[[str], Mapping[str, Any]], names: tuple[str, ...], folder: Path) -> None:
        self._shipped, self._names, self.folder = shipped, names, folder

    def read(self) -> dict[str, Mapping[str, Any]]:
        """Return the mappings in use, ``device -> content``: a person's own where there is one.

        Raises:
            InvalidValueError: a file that is no YAML of commands.
        """
        return {name: self._own(name) if self.file(name).exists() else self._shipped(name) for name in self._names}

    def file(self, name: str) -> Path:
        """Return where a person's own mapping of a device lies, or would."""
        return self.folder / f"{name}.yaml"

    @property
    def own(self) -> tuple[str, ...]:
        """Devices with a file of the person's own."""
        return tuple(name for name in self._names if self.file(name).exists())

    def change(self, wanted: Mapping[str, Mapping[str, tuple[str, ...]]]) -> Bindings:
        """Check keys and buttons, write the files of those devices, and return the bindings of all devices in use.

        Args:
            wanted: device -> command -> controls. Axes stay as they are.

        Raises:
            UnknownNameError, InvalidValueError: the words of a mapping file's own errors; nothing is written.
        """
        if strange := wanted.keys() - (set(CHANGEABLE) & set(self._names)):
            raise InvalidValueError(f"{min(strange)}: its controls are not changed here.")
        mappings = self.read()
        for name, commands in wanted.items():
            axes = {command: bound for command, bound in mappings[name].items() if command in AXIAL}
            mappings[name] = axes | {command: list(controls) for command, controls in commands.items() if controls}
        bindings = bindings_of(mappings)
        if missing := [command for command in NEEDED if not bindings.keys_of(command)]:
            raise InvalidValueError(f"Nothing gives {missing[0]!r} any more. Bind a key or a button to it.")
        for name in wanted:
            write_atomic(self.file(name), HEAD + yaml.safe_dump(dict(mappings[name]), sort_keys=False))
        return bindings

    def reset(self) -> Bindings:
        """Remove the person's own files, and return the bindings that are shipped."""
        for name in self.own:
            self.file(name).unlink()
        return bindings_of(self.read())

    def _own(self, name: str) -> Mapping[str, Any]:
        path = self.file(name)
        try:
            content = yaml.safe_load(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise InvalidValueError(
                f"{path} is no mapping: {error}. Delete it for the keys that are shipped."
            ) from error
        if not isinstance(content, dict):
            raise InvalidValueError(f"{path} is no mapping of commands. Delete it for the keys that are shipped.")
        return content
