"""Formats of datasets, one file each; ``parts`` holds what they share. A file defines

- ``recognises(path) -> bool``: whether it is the format of a file or folder that exists. Exactly one format may say so.
- ``read(path, wanted) -> Source``: what lies there, renamed and never mended; :mod:`aerial_il.data.check`
  judges it, and arrays that may be large are read only when it asks for them (:class:`~aerial_il.data.source.Later`).
- ``write(episodes, out, *, env_spec) -> Path``, where it can: episodes of one environment as one dataset, which appears
  whole or not at all; with ``ENDINGS`` of ``out``, empty for a folder, ``OWN_NAME`` where none is said, ``PARTS`` of a
  folder, the patterns of all that lies in it, without which it replaces nothing, and ``PICTURES = False`` where it has
  no place for images. ``env_spec`` is Gymnasium's, as JSON.
- ``is_current(dataset, out) -> bool``, where that can be told cheaply: whether ``out`` holds the dataset already.
- ``altered(path) -> list[Path]``, where it keeps digests: the files that are not what was written.

Readers raise :class:`DemoError` for what cannot be read, writers :class:`StorageError`.
"""

from pathlib import Path
from types import ModuleType

from aerial_il.core import registry
from aerial_il.core.errors import DemoError


def find(path: Path) -> ModuleType:
    """Return the one format that recognises what lies at ``path``; errors are those of :func:`name_of`."""
    return registry.module("format", name_of(path))


def name_of(path: Path) -> str:
    """Return the name of the one format that recognises what lies at ``path``.

    Raises:
        DemoError: none does, or several do.
    """
    names = registry.names("format")
    found = [name for name in names if registry.module("format", name).recognises(path)]
    if len(found) > 1:
        hint = "Take away what does not belong there, or uninstall the package that brings one of them."
        raise DemoError(path, f"is recognised by several formats: {', '.join(found)}.", hint=hint)
    if not found:
        what = "holds no demonstrations" if path.is_dir() else "is no dataset"
        hint = "Record some with: aerial-il collect; or begin a format of your own: aerial-il new format NAME"
        raise DemoError(path, f"{what} that a format recognises: {', '.join(names)}.", hint=hint)
    return found[0]
