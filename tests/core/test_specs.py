"""Comparing specifications: what a user reads when a policy, a dataset or a session belongs elsewhere."""

from dataclasses import replace

import aerial_il
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec, camera_name, image_name


def spec_of(robot: str, task: str) -> EnvSpec:
    env = aerial_il.load_batch(robot, task, num_envs=1, num_threads=1)
    env.close()
    return env.spec


def test_robot_and_task_come_first_missing_fields_once() -> None:
    mine, theirs = spec_of("fa_hexa_arm4", "pick_place"), spec_of("big_four_z1", "insert_peg")
    differing = mine.differences(theirs)
    assert differing[:2] == ["robot: 'fa_hexa_arm4' != 'big_four_z1'", "task: 'pick_place' != 'insert_peg'"]
    about = [difference for difference in differing if difference.startswith("observation.fields.cube_pos.")]
    assert about == ["observation.fields.cube_pos.shape: [3] != None"]
    assert "observation.fields.joint_pos.shape: [4] != [6]" in differing


def test_a_field_that_both_have_is_compared_in_full() -> None:
    spec = spec_of("fa_hexa_arm4", "reach")
    first, *rest = spec.observation.fields
    other = replace(spec, observation=ObservationSpec((replace(first, unit="km", dtype="float32"), *rest)))
    assert spec.differences(other) == [
        f"observation.fields.{first.name}.dtype: 'float64' != 'float32'",
        f"observation.fields.{first.name}.unit: {first.unit!r} != 'km'",
    ]
    assert spec.differences(spec) == []


def test_a_field_says_by_itself_whether_it_is_a_colour_image() -> None:
    colour, depth = Field("front", (4, 5, 3), "image", "uint8"), Field("a_rgb", (4, 5), "image", "float32")
    numbers = Field("b_rgb", (4, 5, 3), "proprio", "uint8")
    assert [field.is_colour for field in (colour, depth, numbers)] == [True, False, False]
    assert camera_name(image_name("wrist")) == "wrist"
