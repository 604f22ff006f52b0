"""A policy that lerobot has saved flies here as it flies there; one that names code to run is refused."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import aerial_il
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.policies import find_lerobot, load_any_policy
from aerial_il.workflows.parts.pilots import pilot
from tests.algorithms.point_mass import PointMassBatch

STATE, ENVIRONMENT, ACTION, IMAGES = (
    "observation.state",
    "observation.environment_state",
    "action",
    "observation.images.",
)
SIZES = {STATE: 10, ENVIRONMENT: 6, ACTION: 10}


def save(folder: Path, **settings: Any) -> tuple[Any, Any, Any]:
    """Save an untrained ACT of lerobot; return it with its processors."""
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy

    tiny = {"dim_model": 16, "n_heads": 2, "dim_feedforward": 16, "n_encoder_layers": 1, "n_vae_encoder_layers": 1}
    return saved(folder, ACTPolicy, ACTConfig, chunk_size=6, **tiny, **settings)


def save_diffusion(folder: Path, scheduler: str) -> None:
    from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
    from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy

    tiny = {"down_dims": (8, 16), "n_groups": 4, "diffusion_step_embed_dim": 8, "num_train_timesteps": 4}
    saved(folder, DiffusionPolicy, DiffusionConfig, horizon=8, n_action_steps=3, noise_scheduler_type=scheduler, **tiny)


def saved(
    folder: Path,
    policy_class: Any,
    config_class: Any,
    *,
    images: Mapping[str, tuple[int, ...]] | None = None,
    **settings: Any,
) -> tuple[Any, Any, Any]:  # fmt: skip
    from lerobot.configs import FeatureType, PolicyFeature
    from lerobot.policies import make_pre_post_processors

    torch.manual_seed(0)
    kinds = {STATE: FeatureType.STATE, ENVIRONMENT: FeatureType.ENV, ACTION: FeatureType.ACTION}
    features = {name: PolicyFeature(kind, (SIZES[name],)) for name, kind in kinds.items()}
    output = {ACTION: features.pop(ACTION)}
    features |= {f"{IMAGES}{name}": PolicyFeature(FeatureType.VISUAL, shape) for name, shape in (images or {}).items()}
    config = config_class(input_features=features, output_features=output, device="cpu", **settings)
    draws = {
        "mean": torch.randn,
        "std": lambda n: torch.rand(n) + 0.5,
        "min": lambda n: -torch.ones(n),
        "max": torch.ones,
    }
    sizes = {**SIZES, **{f"{IMAGES}{name}": 3 for name in images or {}}}
    statistics = {name: {which: draw(size) for which, draw in draws.items()} for name, size in sizes.items()}
    policy = policy_class(config).eval()
    encode, decode = make_pre_post_processors(config, dataset_stats=statistics)
    for part in (policy, encode, decode):
        part.save_pretrained(folder)
    (folder / "train_config.json").write_text(json.dumps({"dataset": {"repo_id": "local/ua_quad_arm4-reach"}}))
    return policy, encode, decode


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "checkpoints" / "last" / "pretrained_model"
    save(folder, n_action_steps=3)
    return folder


@pytest.mark.parametrize(
    "settings",
    [{"n_action_steps": 3}, {"n_action_steps": 1, "temporal_ensemble_coeff": 0.01}],
    ids=["queue", "ensemble"],
)
def test_it_acts_as_lerobot_lets_it_act(tmp_path: Path, settings: dict[str, Any]) -> None:
    theirs, encode, decode = save(tmp_path / "policy", **settings)
    policy, env = load_any_policy(tmp_path / "policy"), PointMassBatch(3)
    policy.attach(env)
    obs, fields = env.reset(0), env.spec.observation
    for _ in range(8):
        actions = policy.act(obs)
        groups = {STATE: fields.of_group("proprio"), ENVIRONMENT: fields.of_group("task")}
        batch = {k: torch.from_numpy(fields.flatten(obs, [f.name for f in g])).float() for k, g in groups.items()}
        expected = decode(theirs.select_action(encode(batch))).numpy()
        np.testing.assert_allclose(actions, env.spec.action.clip(expected), atol=1e-5)
        obs = env.step(actions).obs


def test_a_reset_world_starts_a_new_chunk_by_itself(folder: Path) -> None:
    together, alone, env = load_any_policy(folder), load_any_policy(folder), PointMassBatch(2)
    together.attach(env)
    alone.attach(env)
    rng = np.random.default_rng(0)
    for t in range(6):
        obs = {f.name: rng.normal(size=(2, *f.shape)) for f in env.spec.observation.fields if f.group != "image"}
        together.reset(np.array([False, t == 2]))
        actions = together.act(obs)
        np.testing.assert_allclose(alone.act({k: v[:1] for k, v in obs.items()})[0], actions[0], atol=1e-5)


@pytest.mark.parametrize("scheduler", ["DDPM", "DDIM"])
def test_what_diffusion_draws_in_one_world_does_not_depend_on_the_others(tmp_path: Path, scheduler: str) -> None:
    pytest.importorskip("diffusers")
    save_diffusion(tmp_path, scheduler)
    flown = {}
    for count in (3, 1):
        policy, env = load_any_policy(tmp_path), PointMassBatch(3)
        policy.attach(env)
        rng = np.random.default_rng(0)
        fields = [f for f in env.spec.observation.fields if f.group != "image"]
        steps = [{f.name: rng.normal(size=(3, *f.shape)) for f in fields} for _ in range(8)]
        flown[count] = [policy.act({name: values[:count] for name, values in obs.items()})[0] for obs in steps]
        assert not np.allclose(flown[count][0], flown[count][3]), "each chunk is drawn anew"
    np.testing.assert_allclose(flown[1], flown[3], atol=1e-5)


def test_a_run_of_the_trainer_is_found_and_tells_its_cell(folder: Path) -> None:
    run = folder.parents[2]
    assert find_lerobot(run) == folder
    flown = pilot(str(run), robot=None, task=None, action=None)
    where = flown.reference
    assert (where.robot, where.task, where.action, where.cameras) == ("ua_quad_arm4", "reach", "ee_pose", ())
    with pytest.raises(InvalidValueError, match="attached"):
        aerial_il.load_policy(str(run)).act(PointMassBatch(1).reset(0))


def test_each_camera_has_the_size_that_it_was_trained_with(tmp_path: Path) -> None:
    images = {"wrist": (3, 64, 80), "base": (3, 96, 64)}
    save(tmp_path / "policy", n_action_steps=3, images=images, pretrained_backbone_weights=None)
    where = pilot(str(tmp_path / "policy"), robot=None, task=None, action=None).reference
    assert where.cameras == ("wrist@64x80", "base@96x64")


def test_another_environment_is_refused_and_both_sizes_are_named(folder: Path) -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1)
    with pytest.raises(InvalidValueError, match=r"observation\.state: \(10,\) != "):
        load_any_policy(folder).attach(env)
    env.close()


def test_code_that_a_file_names_is_not_run(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "policy")
    pipeline = json.loads((copy / "policy_preprocessor.json").read_text())
    pipeline["steps"].append({"class": "os.system", "config": {}})
    (copy / "policy_preprocessor.json").write_text(json.dumps(pipeline))
    with pytest.raises(CheckpointError, match=r"has steps .* that are not run"):
        load_any_policy(copy)


def test_damaged_and_foreign_policies_are_refused(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "cut")
    weights = copy / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-8])
    with pytest.raises(CheckpointError, match="cannot be loaded"):
        load_any_policy(copy)
    copy = shutil.copytree(folder, tmp_path / "foreign")
    config = json.loads((copy / "config.json").read_text())
    (copy / "config.json").write_text(json.dumps({**config, "type": "pi0"}))
    with pytest.raises(CheckpointError, match="kind 'pi0'; those of kind act, diffusion"):
        load_any_policy(copy)
