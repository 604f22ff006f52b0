"""The one registry: kinds by their files and by entry points of other packages; keys that have new names."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.renamed import MOVED

each_kind = pytest.mark.parametrize("kind", sorted(registry.KINDS))


@each_kind
def test_everything_registered_can_be_had_by_its_name(kind: str) -> None:
    assert registry.names(kind)
    for name in registry.names(kind):
        assert registry.get(kind, name) is not None


@each_kind
def test_an_unknown_name_is_told_with_the_choices(kind: str) -> None:
    with pytest.raises(UnknownNameError, match=registry.names(kind)[0]):
        registry.get(kind, "no_such_thing")


@pytest.fixture
def plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installed package's metadata, with entry points that the test writes into it."""
    info = tmp_path / "some_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-package\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry.outside.cache_clear()
    yield tmp_path
    sys.modules.pop("some_task", None)
    registry.outside.cache_clear()


def test_a_package_outside_registers_by_an_entry_point(plug_in: Path) -> None:
    (plug_in / "some_task.py").write_text("TASK = 'the task'\n")
    (plug_in / "some_package-1.0.dist-info" / "entry_points.txt").write_text("[aerial_il.task]\nfold = some_task\n")
    assert "fold" in registry.names("task")
    assert registry.get("task", "fold") == "the task"


def test_a_file_that_defines_nothing_is_refused(plug_in: Path) -> None:
    (plug_in / "some_task.py").write_text("")
    (plug_in / "some_package-1.0.dist-info" / "entry_points.txt").write_text("[aerial_il.task]\nfold = some_task\n")
    with pytest.raises(InvalidValueError, match="some_task defines no TASK"):
        registry.get("task", "fold")


def test_a_function_that_is_not_compiled_is_refused(plug_in: Path) -> None:
    (plug_in / "some_task.py").write_text("def read(own, world, seen, found):\n    found[0] = 1.0\n")
    (plug_in / "some_package-1.0.dist-info" / "entry_points.txt").write_text("[aerial_il.sensor]\nfold = some_task\n")
    assert registry.kernel("sensor", "fold", "no_such", needed=False) is None
    with pytest.raises(InvalidValueError, match="some_task defines no no_such, which a sensor must have"):
        registry.kernel("sensor", "fold", "no_such")
    with pytest.raises(InvalidValueError, match=r"some_task\.read must be compiled: write @kernel above it"):
        registry.kernel("sensor", "fold", "read")


def test_a_package_outside_does_not_take_a_name_that_is_ours(plug_in: Path) -> None:
    (plug_in / "some_package-1.0.dist-info" / "entry_points.txt").write_text("[aerial_il.task]\nreach = some_task\n")
    with pytest.raises(InvalidValueError, match=r"some_task registers a task called reach, but aerial_il\.suite"):
        registry.names("task")


def test_no_key_leads_to_itself_or_to_another_old_one() -> None:
    assert not set(MOVED) & {new for places in MOVED.values() for new in places}
