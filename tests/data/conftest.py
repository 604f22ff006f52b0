"""A small dataset of crane flights, recorded once."""

from pathlib import Path

import pytest

from aerial_il.collection.collect import collect
from aerial_il.data.folder import DatasetFolder
from tests.data.crane import CraneBatch, CraneExpert


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    """Six flights of which two fail, without cameras. Read only."""
    out = tmp_path_factory.mktemp("cranes")
    return collect(CraneBatch(3), CraneExpert(), range(6), out, progress=False).folder


@pytest.fixture(scope="session")
def demo(folder: DatasetFolder) -> Path:
    """The file of one success."""
    return folder.files()[0]
