"""Fields that others call otherwise are matched by their shape where that is clear, and never guessed apart."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.data.dataset import open_dataset
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.foreign_fields import shown_for, under_their_names
from experiments.foreign import layouts

STEPS = 12


def policy_of(place: Path, **fields: np.ndarray) -> ChunkPolicy:
    """A policy that learned hardly anything from a file whose fields have these names."""
    demo = {"obs": fields, "actions": np.linspace(-2, 2, STEPS)[:, None]}
    file = layouts.robomimic(place / "theirs.hdf5", demo, demo)
    return BC(steps=2, validation=0.0).train(
        open_dataset(file), MLP(hidden=(8,), chunk=2), run=place / "run", progress=False
    )


def test_the_only_field_of_a_shape_stands_for_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(0)
    policy = policy_of(tmp_path, flat=rng.normal(size=(STEPS, 3)))
    env = aerial_il.load_gymnasium("Pendulum-v1", num_envs=2)
    policy.attach(env)
    assert "The policy's flat is the environment's observation, the only field of its shape." in caplog.text
    obs = env.reset(0)
    first = policy.act(obs)
    policy.reset()
    np.testing.assert_array_equal(policy.act({"flat": obs["observation"], **obs}), first)
    np.testing.assert_array_equal(policy.fresh().act(obs), first)


@pytest.mark.parametrize("widths", [(2,), (3, 3)])
def test_what_fits_nowhere_or_twice_is_refused(widths: tuple[int, ...], tmp_path: Path) -> None:
    fields = {f"field{i}": np.random.default_rng(i).normal(size=(STEPS, width)) for i, width in enumerate(widths)}
    policy = policy_of(tmp_path, **fields)
    with pytest.raises(InvalidValueError, match=r"observation\.fields\.field0\.shape"):
        policy.attach(aerial_il.load_gymnasium("Pendulum-v1", num_envs=1))


def specified(**shapes: tuple[int, ...]) -> EnvSpec:
    spec = aerial_il.load_gymnasium("Pendulum-v1", num_envs=1).spec
    fields = (
        Field(name, shape, "image" if len(shape) == 3 else "proprio", "uint8" if len(shape) == 3 else "float32")
        for name, shape in shapes.items()
    )
    return replace(spec, observation=ObservationSpec(tuple(fields)))


def test_names_that_are_there_are_kept_and_others_matched() -> None:
    theirs = specified(state=(6,), top_rgb=(8, 8, 3), speed=(2,))
    there = specified(joints=(6,), image=(8, 8, 3), speed=(2,), target=(2,))
    shown = shown_for(theirs, ("state", "top_rgb", "speed"), there)
    assert shown == {"state": "joints", "top_rgb": "image"}
    assert under_their_names(there, shown).observation.names == ("state", "top_rgb", "speed", "target")
    assert shown_for(theirs, ("state", "speed"), specified(one=(6,), two=(6,), speed=(2,))) == {}
    assert shown_for(specified(a=(6,), b=(6,)), ("a", "b"), specified(one=(6,))) == {}


def test_ones_own_fields_are_never_matched_by_shape(tmp_path: Path) -> None:
    """Where the environment was recorded here, another name means another thing."""
    policy = policy_of(tmp_path, flat=np.random.default_rng(0).normal(size=(STEPS, 3)))
    own = replace(policy.spec, action=replace(policy.spec.action, level="native"))
    policy.interface = replace(policy.interface, layout=replace(policy.interface.layout, spec=own))
    with pytest.raises(InvalidValueError, match="flat"):
        policy.check(aerial_il.load_gymnasium("Pendulum-v1", num_envs=1).spec)
