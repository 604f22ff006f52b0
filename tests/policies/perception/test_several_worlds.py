"""What a policy behind cameras draws depends on its own episode, whoever flies beside it."""

from pathlib import Path

import numpy as np
import pytest
import torch

from aerial_il import experts, load_batch
from aerial_il.collection.collect import collect
from aerial_il.core.seeding import torch_rng
from aerial_il.data.dataset import open_dataset
from aerial_il.policies import get
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import Targets

CELL = ("fa_hexa_arm4", "pick_place")
CAMERAS = {"cameras": ("wrist", "base"), "image_size": (64, 64)}


@pytest.mark.render
def test_random_numbers_do_not_depend_on_the_worlds_beside(tmp_path: Path) -> None:
    collect(load_batch(*CELL, num_envs=2), experts.make(*CELL), range(2), tmp_path, progress=False)
    demos = open_dataset(tmp_path)
    alone, several = (load_batch(*CELL, num_envs=n, num_threads=1, **CAMERAS) for n in (1, 4))
    config = get("flow")(chunk=8, execute=4, ensemble=None)
    layout, size = Layout.of(alone.spec, config), alone.spec.action.size
    interface = Interface(layout, Normaliser.none(layout.size), Normaliser.none(size), 10.0, Switches.none(size))
    with torch_rng(0, "eyes"), torch.no_grad():
        pilot = ChunkPolicy(config, interface, config.build(layout.size, size))
        targets = Targets.of(alone.spec.observation, [dict(demo.obs) for demo in demos], layout.names)
        eyes = Eyes.of(alone.spec, ("wrist_rgb", "base_rgb"), targets, 16)
        for weight in eyes.parameters():
            weight.add_(0.05 * torch.randn_like(weight))
    actions = []
    for env in (alone, several):
        policy = PerceivingPolicy(pilot, eyes, every=2, forget=0.9)
        policy.attach(env)
        actions.append(policy.act(env.reset(np.arange(7, 7 + env.num_envs)))[0])
        env.close()
    np.testing.assert_allclose(actions[0], actions[1], atol=1e-3)
