"""What a person prints fits a screen and says what it is."""

from __future__ import annotations

from pathlib import Path

import pytest

import aerial_il


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("printed") / "hover"
    aerial_il.collect(robot="quad", task="hover", episodes=1, out=out, progress=False)
    return out


def test_objects_print_in_a_few_lines(flown: Path) -> None:
    dataset = aerial_il.open_dataset(flown)
    single, batch = aerial_il.load("quad", "hover"), aerial_il.load_batch("quad", "hover", num_envs=2)
    for thing in (dataset, dataset[0], dataset.spec, dataset.spec.observation, dataset.spec.action, single, batch):
        said = repr(thing)
        assert len(said) < 600, said
        assert " at 0x" not in said
    assert "quad/hover" in repr(dataset[0])
    assert "2 worlds" in repr(batch)
    single.close()
    batch.close()
