"""Things added from outside, one file each: they are found by entry points, as those of an installed package are."""

import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from aerial_il import robots
from aerial_il.core import registry
from aerial_il.suite import tasks, tiers


@contextmanager
def plugged_in(modules: Mapping[str, Mapping[str, str]]) -> Iterator[None]:
    """Have a package installed, for a while, that brings modules: kind -> name -> module."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        info = Path(folder) / "some_package-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-package\nVersion: 1.0\n")
        lines = [
            f"[aerial_il.{kind}]\n" + "".join(f"{n} = {m}\n" for n, m in of.items()) for kind, of in modules.items()
        ]
        (info / "entry_points.txt").write_text("\n".join(lines))
        patch.syspath_prepend(folder)
        _forget()
        yield
    _forget()


def _forget() -> None:
    importlib.invalidate_caches()
    for result in (registry.outside, tiers.get, robots.get, robots.is_readable, tasks.get, tasks.cells):
        result.cache_clear()
