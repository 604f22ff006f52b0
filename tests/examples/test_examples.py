"""A squall, an altimeter and a stereo rig: one new file each, nothing edited, and every contract is kept."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.cli.main import main
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError
from aerial_il.suite import tiers
from tests.contract import test_disturbances, test_scene, test_sensors
from tests.contract.registered import batch, single
from tests.examples import plugged_in

HERE = "tests.examples"
ALL = {
    "disturbance": {"squall": f"{HERE}.squall"},
    "sensor": {"altimeter": f"{HERE}.altimeter"},
    "robot": {"stereo_quad": f"{HERE}.stereo_quad", "laser_quad": "laser_quad"},
}
LASER_QUAD = """from dataclasses import replace
from aerial_il.robots import quad
ROBOT = replace(quad.ROBOT, name="laser_quad", sensors={**quad.ROBOT.sensors, "altimeter": {"reach": 1.0}})
"""


@pytest.fixture(scope="module", autouse=True)
def added(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    place = Path(tmp_path_factory.mktemp("plug_in"))
    (place / "laser_quad.py").write_text(LASER_QUAD)
    with pytest.MonkeyPatch.context() as patch, plugged_in(ALL):
        patch.syspath_prepend(str(place))
        patch.setattr(test_sensors, "CELLS", aerial_il.list_cells())
        patch.setattr(test_scene, "CELLS", aerial_il.list_cells())
        yield
    batch.cache_clear()
    single.cache_clear()


def test_a_squall_keeps_the_contract() -> None:
    assert "squall" in registry.names("disturbance")
    assert tiers.get("calm+squall").name == "calm+squall"
    test_disturbances.test_settings_are_plain_frozen_and_explained("squall")
    test_disturbances.test_it_does_something("squall")
    test_disturbances.test_its_memory_is_of_the_size_that_it_says("squall")
    test_disturbances.test_kernels_stay_within_their_memory("squall")
    test_disturbances.test_a_flight_repeats_resumes_and_needs_no_company("squall")
    test_disturbances.test_what_is_drawn_is_recorded("squall")


def test_a_squall_blows_once_and_then_it_is_over() -> None:
    worlds = aerial_il.load_batch("quad", "hover", num_envs=2, tier="calm+squall")
    still, obs = aerial_il.load_batch("quad", "hover", num_envs=2), worlds.reset(0)
    hold, begins = np.concatenate([obs["ee_pos"], obs["ee_rot6d"]], axis=1), worlds.drawn(0)["squall_begins_s"]
    still.reset(0)
    winds = []
    for _ in range(round((begins + 3.0) / 0.02)):
        worlds.step(hold)
        still.step(hold)
        winds.append(np.linalg.norm(worlds.simulation.disturbances.table.effects["wind"][0]))
    blowing = np.flatnonzero(np.array(winds) > 0.0)
    assert blowing[0] * 0.02 == pytest.approx(begins, abs=0.05)
    assert np.ptp(blowing) * 0.02 == pytest.approx(1.9, abs=0.05)
    assert np.abs(worlds.simulation.view.qpos - still.simulation.view.qpos).max() > 1e-3


def test_a_state_of_another_tier_is_refused() -> None:
    squall, other = (aerial_il.load_batch("quad", "hover", num_envs=1, tier=f"calm{more}") for more in ("+squall", ""))
    other.reset(0)
    squall.reset(0)
    with pytest.raises(InvalidValueError, match="States have shape"):
        squall.set_state(other.get_state())
    states = squall.get_state()
    states[:, -4] = 1.0
    with pytest.raises(InvalidValueError, match="remember no squall, or have it elsewhere"):
        squall.set_state(states)


def test_an_altimeter_keeps_the_contract() -> None:
    assert "laser_quad" in robots.names()
    test_sensors.test_its_fields_are_documented("altimeter")
    test_sensors.test_it_writes_its_fields_and_nothing_else("altimeter")
    test_sensors.test_what_it_reads_is_what_is_observed("altimeter")


def test_an_altimeter_measures_height_with_its_noise() -> None:
    worlds = aerial_il.load_batch("laser_quad", "hover", num_envs=64)
    obs = worlds.reset(0)
    height = worlds.simulation.view.base_pos[:, 2] / worlds.simulation.view.base_mat[:, 8]
    near = height < 0.95
    errors = (obs["altimeter"][:, 0] - height)[near]
    assert 0.003 < errors.std() < 0.02
    assert (obs["altimeter"] <= 1.0).all()


@pytest.mark.render
def test_a_stereo_rig_sees_with_both_eyes() -> None:
    test_scene.test_a_camera_is_an_observation_of_its_size("stereo_quad")
    test_scene.test_each_sees_something_of_its_own("stereo_quad")
    worlds = aerial_il.load_batch("stereo_quad", "hover", num_envs=1, cameras=("left", "right", "down"))
    obs = worlds.reset(0)
    assert obs["left_rgb"].shape == obs["right_rgb"].shape == (1, 96, 128, 3)
    assert obs["down_rgb"].shape == (1, 240, 320, 3)
    worlds.close()


@pytest.mark.parametrize(
    ("text", "said"), [("ROBOT = (", "SyntaxError: '(' was never closed"), ("ROBOT = max(1)", "TypeError")]
)
def test_a_file_that_cannot_be_read_hides_no_other(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken_robot.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with plugged_in({"robot": {"broken": "broken_robot"}}):
        assert main(["list"]) == 0
        told = capsys.readouterr()
        assert "ua_quad_arm4" in told.out
        assert f"robot broken, {tmp_path / 'broken_robot.py'}, cannot be read: {said}" in told.err
        assert main(["evaluate", "policy=expert", "robot=broken", "task=hover", f"out={tmp_path / 'out'}"]) == 2
        assert said in capsys.readouterr().err
