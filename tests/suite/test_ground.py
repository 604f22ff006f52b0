"""A bare base on its skids: it stands, soft landings count and hard ones never do, a rotor that strikes is a crash."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.skids import STAND_M
from aerial_il.suite.tasks.land import HARDEST, SOFT_M_S

DROPS_M = (0.005, 0.02, 0.04, 0.10, 0.30)


def dropped() -> tuple[BatchEnvironment, list[np.ndarray]]:
    """Return worlds in which the base fell on the pad from so many heights, rotors off, and its heights on the way."""
    worlds = aerial_il.load_batch("quad", "land", num_envs=len(DROPS_M), action="rotor", num_threads=1)
    worlds.reset(0)
    view = worlds.simulation.view
    view.qpos[:, :3] = view.mocap_pos[:, view.mocap_id("pad")] + np.array([[0.0, 0.0, STAND_M + h] for h in DROPS_M])
    view.qpos[:, 3:7], view.qvel[:] = [1.0, 0.0, 0.0, 0.0], 0.0
    view.thrust[:] = 0.0
    off = np.zeros((len(DROPS_M), 4))
    heights = []
    for _ in range(100):
        result = worlds.step(off)
        heights.append(view.base_pos[:, 2].copy())
    heights.append(result.info["success"])
    return worlds, heights


def test_it_rests_on_its_skids_and_only_soft_landings_count() -> None:
    worlds, (*heights, success) = dropped()
    np.testing.assert_allclose(heights[-1], STAND_M, atol=1e-3)
    assert np.ptp(heights[-20:], axis=0).max() < 1e-4, "it neither sinks nor bounces"
    hardest = worlds.simulation.view.task_state[:, HARDEST]
    fallen = np.sqrt(2.0 * 9.81 * np.array(DROPS_M))
    np.testing.assert_allclose(hardest, fallen, atol=9.81 * 0.03)  # as seen up to a control step before
    np.testing.assert_array_equal(success, hardest <= SOFT_M_S)
    assert success[0]
    assert not success[-1]


def test_standing_is_no_crash_and_lying_is_one() -> None:
    worlds, _ = dropped()
    assert not worlds.simulation.reassess().crash.any()
    view = worlds.simulation.view
    view.qpos[:, 2], view.qpos[:, 3:7] = 0.1, [np.cos(0.6), np.sin(0.6), 0.0, 0.0]  # 69 degrees: a rotor in the ground
    result = worlds.step(np.zeros((len(DROPS_M), 4)))
    assert result.info["crash"].all()


@pytest.mark.parametrize("task", ["take_off", "land"])
def test_arms_have_no_room_for_landing_gear(task: str) -> None:
    assert [robot for robot, other in aerial_il.list_cells() if other == task] == ["quad"]
