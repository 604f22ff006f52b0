"""What decides under which name a stage is kept: settings, but for those that came later and change nothing."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from typing import Any

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.perception import Perception
from experiments.common.demonstrations import Source
from experiments.common.plain import LATER, plain
from experiments.generation.study import Out

CELL = Source(robot="quad", task="hover")
CLASSES = {"BC": BC, "DAgger": DAgger, "Perception": Perception, "Out": partial(Out, CELL)}
OTHER = {"auxiliary": 0.5, "stale_rounds": 2, "device": "cuda", "execute": 4, "lead": 5}


@pytest.mark.parametrize(("kind", "name"), LATER)
def test_what_came_later_counts_only_where_it_changes_something(kind: str, name: str):
    before: Any = {name: LATER[kind, name]}
    changed: Any = {name: OTHER[name]}
    settings = CLASSES[kind]()
    assert name in {each.name for each in fields(settings)}
    assert name not in plain(replace(settings, **before))
    assert plain(replace(settings, **changed))[name] == OTHER[name]


def test_all_else_counts_at_its_default_too():
    assert plain(BC())["obs_noise"] == 0.0
    assert plain(BC()) != plain(replace(BC(), obs_noise=0.1))
