"""An old key is answered with its new name, and only with one that is there."""

from __future__ import annotations

import pytest

from aerial_il.cli.configuration.overrides import new_key
from aerial_il.core.renamed import ALGORITHM_KEYS

TABLE = {"cloning": "bc_weight", "training.memory": "training.buffer_size"}
KNOWN = ("algorithm.bc_weight", "algorithm.training.buffer_size", "bench.dac.bc_weight")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("algorithm.cloning", "algorithm.bc_weight"),
        ("algorithm.training.memory", "algorithm.training.buffer_size"),
        ("bench.dac.cloning", "bench.dac.bc_weight"),
        ("bench.cloning", None),  # a benchmark has no such key
        ("algorithm.memory", None),
        ("algorithm.steps", None),
        ("cloning", None),
    ],
)
def test_an_old_key_leads_to_its_new_name_where_that_is_known(old: str, new: str | None) -> None:
    assert new_key(old, KNOWN, TABLE) == new


def test_no_name_leads_to_itself_or_to_another_old_one() -> None:
    assert not set(ALGORITHM_KEYS) & set(ALGORITHM_KEYS.values())
