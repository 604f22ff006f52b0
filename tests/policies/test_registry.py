"""Every policy file obeys one contract; one policy learns several tasks and is told which it flies."""

import sys
from dataclasses import replace
from pathlib import Path
from subprocess import run
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from aerial_il import policies
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.training_set import read_demos
from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import CheckpointError, InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.parts.tasks import tasks_of, unite
from tests.algorithms.point_mass import SPEC, PointMassBatch, demonstrations, with_action_level

SIZES = {"history": 2, "chunk": 5}
NAMES = [  # importing lerobot takes seconds, and so does training its networks
    pytest.param(name, marks=pytest.mark.slow) if name.startswith("lerobot_") else name for name in policies.names()
]


def fresh_policy(name: str, **settings: object) -> ChunkPolicy:
    config = policies.get(name)(**{**SIZES, **settings})
    layout = Layout.of(SPEC, config)
    data = np.random.default_rng(0)
    scalers = (Normaliser.fit(data.normal(size=(99, size))) for size in (layout.size, SPEC.action.size))
    interface = Interface(layout, *scalers, config.obs_clip, Switches.none(layout.spec.action.size))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, config.build(layout.size, SPEC.action.size), {"step": 3})


@pytest.mark.parametrize("name", NAMES)
def test_networks_map_histories_to_chunks_and_mask_their_loss(name: str) -> None:
    policy = fresh_policy(name)
    network = policy.network
    obs, actions = torch.randn(4, 2, policy.interface.layout.size), torch.randn(4, 5, 10)
    assert network(obs).shape == (4, 5, 10)
    valid = torch.ones(4, 5)
    valid[:, 3:] = 0

    def loss_of(valid: torch.Tensor) -> torch.Tensor:
        torch.manual_seed(0)
        return network.loss(obs, actions, valid)[0]

    loss = loss_of(valid)
    actions[:, 3:] += 100
    assert loss.ndim == 0
    assert torch.equal(loss, loss_of(valid))
    assert not torch.equal(loss, loss_of(torch.ones(4, 5)))


@pytest.mark.parametrize("name", NAMES)
def test_a_saved_policy_flies_alone_and_alike(name: str, tmp_path: Path) -> None:
    policy = fresh_policy(name)
    again = load_policy(policy.save(tmp_path / "policy"))
    assert (again.config, again.spec, again.origin) == (policy.config, policy.spec, {"step": 3})
    env = PointMassBatch(3)
    obs = env.reset(0)
    for _ in range(4):
        action = policy.act(obs)
        np.testing.assert_array_equal(again.act(obs), action)
        assert action.shape == (3, 10)
        assert action.dtype == np.float64
        assert (action >= SPEC.action.low).all()
        assert (action <= SPEC.action.high).all()
        obs = env.step(action).obs


@pytest.mark.parametrize("name", NAMES)
def test_settings_survive_yaml(name: str) -> None:
    config = policies.get(name)(**SIZES)
    assert policies.get(name)(**yaml.safe_load(yaml.safe_dump(config.to_dict()))) == config
    assert config.name == name


@pytest.mark.parametrize("settings", [{"history": 0}, {"chunk": 0}, {"execute": 6}, {"obs_clip": 0}])
@pytest.mark.parametrize("name", NAMES)
def test_impossible_settings_are_refused(name: str, settings: dict[str, int]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(settings))):
        policies.get(name)(**{**SIZES, **settings})


def test_a_single_name_or_width_stands_for_a_list_of_it() -> None:
    """A command line writes ``policy.masked_fields=target_*``, which must not be read letter by letter."""
    config = MLP(masked_fields="target_*", hidden=256, images=["wrist_rgb"])  # type: ignore[arg-type]
    assert (config.masked_fields, config.hidden, config.images) == (("target_*",), (256,), ("wrist_rgb",))
    assert replace(BC.selection, operators="expert").operators == ("expert",)  # type: ignore[arg-type]


def test_names_come_without_importing_torch() -> None:
    code = "import sys; from aerial_il import policies; policies.names(); print('torch' in sys.modules)"
    assert run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "False"


def test_unknown_policies_and_paths_say_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'mlp'"):
        policies.get("mpl")
    with pytest.raises(CheckpointError, match="does not exist"):
        load_policy(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="neither a policy nor a run"):
        load_policy(tmp_path)


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
        DatasetFolder(tmp_path / task).claim(replace(SPEC, task=task))
        (tmp_path / task / "demos").mkdir(exist_ok=True)
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
    cloud = replace(demos[0], uid="of another", spec=replace(SPEC, robot="cloud"))
    for mixed in ([cloud, demos[0], demos[-1]], [demos[0], cloud, demos[-1]]):
        with pytest.raises(InvalidValueError, match="robot"):
            unite(mixed)


def test_what_was_saved_under_an_older_name_of_a_setting_still_flies(tmp_path: Path) -> None:
    policy = fresh_policy("mlp")
    saved = policy.to_checkpoint()
    settings = {"blind_to" if n == "masked_fields" else n: value for n, value in saved.config["settings"].items()}
    checkpoint.save(tmp_path / "old", Checkpoint(saved.arrays, saved.state, {**saved.config, "settings": settings}))
    assert load_policy(tmp_path / "old").config == policy.config
