"""One policy learns several tasks of a robot and flies each of them, told which one it is by the environment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.training_set import read_demos
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.tasks import tasks_of, unite
from tests.algorithms.point_mass import SPEC, demonstrations, with_action_level

HOOK = Field("hook_pos", (3,), "task", unit="m", labels=("x", "y", "z"))
KEPT = tuple(field for field in SPEC.observation.fields if field.name != "cube_pos")
HANG = replace(SPEC, task="hang", observation=ObservationSpec((*KEPT, HOOK)), max_steps=90, instruction="Hang it up.")


class World:
    """Only what a policy asks of an environment."""

    def __init__(self, spec: EnvSpec) -> None:
        self.spec = spec


def hanging(demo: Episode) -> Episode:
    """The same flight as one of another task: its cube a hook, and all it does the other way round."""
    obs = {k: v for k, v in demo.obs.items() if k != "cube_pos"} | {"hook_pos": demo.obs["cube_pos"]}
    actions = demo.expert_actions.copy()
    actions[:, :3] = 2 * demo.obs["ee_pos"][:-1] - actions[:, :3]
    return replace(demo, uid=f"{demo.uid}-hang", spec=HANG, obs=obs, expert_actions=actions)


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    picked = demonstrations(12)
    return [*picked, *map(hanging, picked)]


@pytest.fixture(scope="module")
def policy(demos: list[Episode], tmp_path_factory: pytest.TempPathFactory) -> ChunkPolicy:
    settings = BC(steps=250, batch_size=128, lr=3e-3, warmup_steps=20, ema=0.95, validation=0)
    config = MLP(hidden=(64, 64), chunk=3)
    settings.train(demos, config, run=(run := tmp_path_factory.mktemp("run")), progress=False)
    return load_policy(run)


def test_fields_are_united_and_absent_ones_are_zero(demos: list[Episode]) -> None:
    layout, united = read_demos(demos, MLP())
    assert tasks_of(layout.spec) == ("hang", "pick")
    assert layout.spec.task == "hang+pick"
    assert layout.spec.max_steps == SPEC.max_steps
    assert {"cube_pos", "hook_pos", "task_id"} < set(layout.names)
    first, last = united[0].obs, united[-1].obs
    np.testing.assert_array_equal(first["hook_pos"], np.zeros_like(first["cube_pos"]))
    np.testing.assert_array_equal(first["task_id"], np.tile([0.0, 1.0], (len(first["ee_pos"]), 1)))
    np.testing.assert_array_equal(last["task_id"], np.tile([1.0, 0.0], (len(last["ee_pos"]), 1)))


def test_a_folder_of_datasets_is_a_dataset(tmp_path: Path) -> None:
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.folder import DatasetFolder

    for task in ("a", "b"):
        (tmp_path / task / "demos").mkdir(parents=True)
        DatasetFolder(tmp_path / task).claim(replace(SPEC, task=task))
        (tmp_path / task / "demos" / f"{task}-0.mcap").touch()
    assert open_dataset(tmp_path).uids == ("a-0", "b-0")


def test_one_task_stays_what_it_is(demos: list[Episode]) -> None:
    assert unite(demos[:12]) == demos[:12]
    assert tasks_of(SPEC) == ("pick",)


def test_it_does_in_each_task_what_was_demonstrated_there(demos: list[Episode], policy: ChunkPolicy) -> None:
    for spec, shown in ((SPEC, demos[3]), (HANG, demos[15])):
        policy.attach(World(spec))
        policy.reset()
        seen = {k: v[:-1] for k, v in shown.obs.items()}
        moves, shown_moves = ((a[:, :3] - seen["ee_pos"]).ravel() for a in (policy.act(seen), shown.expert_actions))
        assert np.corrcoef(moves, shown_moves)[0, 1] > 0.5, "and so the other way round in the other task"


def test_it_must_be_told_which_task_it_flies(demos: list[Episode], policy: ChunkPolicy) -> None:
    again: Any = ChunkPolicy(policy.config, policy.interface, policy.network)
    with pytest.raises(UnknownNameError, match=r"'hang\+pick'.*hang, pick.*Attach it"):
        again.act({k: v[:2] for k, v in demos[0].obs.items()})
    with pytest.raises(InvalidValueError, match="task: 'hang\\+pick' != 'drop'"):
        again.attach(World(replace(SPEC, task="drop")))
    with pytest.raises(InvalidValueError, match="robot"):
        again.attach(World(replace(HANG, robot="cloud")))


def test_what_cannot_be_learned_together_is_refused(demos: list[Episode]) -> None:
    with pytest.raises(InvalidValueError, match=r"pick and hang cannot be learned together: action\.level"):
        unite([demos[0], with_action_level(demos[-1], "velocity")])
    wide = replace(HANG, observation=ObservationSpec((*KEPT[1:], replace(KEPT[0], shape=(2,)))))
    with pytest.raises(InvalidValueError, match="'ee_pos' of hang is not that of the other tasks"):
        unite([demos[0], replace(demos[-1], spec=wide)])
