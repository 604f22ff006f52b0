"""From cameras to a policy that flies through them, by the commands that people use."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.parts.pilots import pilot

CELL = ["robot=ua_quad_arm4", "task=reach"]
SEES = ["policy.images=[wrist_rgb,base_rgb]", "policy.obs_names=[ee_pos,ee_rot6d]", "policy.image_features=8"]
SHORT = ["algorithm.steps=2", "algorithm.batch_size=4", "progress=false"]


@pytest.mark.render
def test_a_policy_flies_through_the_cameras_it_learned_from(tmp_path: Path) -> None:
    data, folder = tmp_path / "seen", tmp_path / "run"
    pictures = ["cameras=[wrist,base]", "image_size=[20,24]", "episodes=2", "progress=false"]
    assert main(["collect", *CELL, *pictures, f"out={data}"]) == 0
    assert main(["train", f"dataset={data}", *SEES, *SHORT, f"run={folder}"]) == 0
    flown = pilot(str(folder), robot=None, task=None, action=None)
    assert (flown.reference.cameras, flown.reference.image_size) == (("wrist", "base"), (20, 24))
    env = flown.environment("calm", num_envs=2, threads=1)
    try:
        flown.policy.attach(env)
        assert flown.policy.act(env.reset(10_000)).shape == (2, env.spec.action.size)
    finally:
        env.close()
    wrong = pilot("hover", robot="ua_quad_arm4", task="reach", action=None).environment("calm", num_envs=1, threads=1)
    with pytest.raises(InvalidValueError, match="sees wrist_rgb 20 x 24, base_rgb 20 x 24; the environment shows no"):
        flown.policy.attach(wrong)
    wrong.close()
