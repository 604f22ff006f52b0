"""Onboard is what a robot knows by itself: the rest is hidden from any policy, and whoever is shown more says so."""

from __future__ import annotations

from contextlib import closing

import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.layout import TO_BE_SEEN
from aerial_il.workflows.train import Dataset, Train, train
from tests.links.test_fly import fresh_policy


@pytest.mark.render
def test_what_has_to_be_seen_is_hidden_and_told():
    env = aerial_il.load_batch("ua_quad_arm4", "press_button", num_envs=1, cameras=("wrist",), image_size=(32, 32))
    with closing(env):
        hidden = fresh_policy("mlp", spec=env.spec, masked_fields=(TO_BE_SEEN,))
        shown = fresh_policy("mlp", spec=env.spec, masked_fields=())
    assert not {*hidden.interface.layout.names} & {*env.spec.observation.to_be_seen}
    assert "tool_force" in hidden.interface.layout.names, "it is felt"
    assert (hidden.observations, shown.observations) == ("onboard", "truth")


def test_one_field_too_many_is_the_truth():
    env = aerial_il.load_batch("ua_quad_arm4", "press_button", num_envs=1)
    with closing(env):
        own = tuple(f.name for f in env.spec.observation.fields if f.is_onboard)
        cheat = fresh_policy("mlp", spec=env.spec, obs_names=(*own, "button_travel"), masked_fields=())
        honest = fresh_policy("mlp", spec=env.spec, obs_names=own, masked_fields=())
    assert (cheat.observations, honest.observations) == ("truth", "onboard")


def test_onboard_without_images_is_refused(tmp_path):
    settings = Train(dataset=Dataset(path=str(tmp_path)), run=str(tmp_path / "run"), observations="onboard")
    with pytest.raises(InvalidValueError, match=r"policy\.images=\[wrist_rgb,base_rgb\]"):
        train(settings)


@pytest.mark.parametrize(
    "shown",
    [{"obs_names": ("ee_pos", "ee_rot6d", "button_pos")}, {"anchor": "button_pos"}],
)
@pytest.mark.render
def test_what_is_hidden_cannot_be_shown_by_another_setting(shown):
    env = aerial_il.load_batch("ua_quad_arm4", "press_button", num_envs=1, cameras=("wrist",), image_size=(32, 32))
    with closing(env), pytest.raises(InvalidValueError, match=r"shows button_pos, and observations=onboard hides it"):
        fresh_policy("mlp", spec=env.spec, masked_fields=(TO_BE_SEEN,), images=("wrist_rgb",), **shown)


def test_what_others_do_not_say_is_taken_for_the_truth():
    with closing(aerial_il.load_gymnasium("CartPole-v1")) as env:
        assert fresh_policy("mlp", spec=env.spec, masked_fields=(), anchor=None, relative=False).observations == "truth"
