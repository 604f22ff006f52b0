"""Every seed is flown once, whatever the number of worlds, and NaN stops with step and seed."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError, SimulationDivergedError
from aerial_il.evaluation.rollouts import evaluate, rollouts
from tests.data.crane import CraneBatch, CraneExpert, crane_spec

SEEDS = range(100, 130)


def fly(num_envs: int, seeds: Any = SEEDS, policy: Any = None, env: CraneBatch | None = None) -> Any:
    env = env or CraneBatch(num_envs)
    return evaluate(env, policy or CraneExpert(dive=True), seeds, policy_name="test", progress=False)


def test_the_result_does_not_depend_on_the_number_of_worlds() -> None:
    one, some, many = (fly(n) for n in (1, 7, 64))
    assert one.episodes == some.episodes == many.episodes
    assert one.metrics == some.metrics == many.metrics
    for seed in SEEDS:
        np.testing.assert_array_equal(one.flights[seed].actions, many.flights[seed].actions)


def test_the_worlds_show_every_end_but_a_drop() -> None:
    ends = dict(fly(8).metrics["ends"])
    assert sum(ends.values()) == len(SEEDS)
    assert ends.pop("dropped") == 0, "they carry nothing"
    assert min(ends.values()) > 0


@pytest.mark.parametrize("num_envs", [1, 4, 30, 50])
def test_no_seed_is_lost_or_doubled(num_envs: int) -> None:
    env = CraneBatch(num_envs)
    flown = Counter(trace.seed for trace in rollouts(env, CraneExpert(dive=True), SEEDS))
    assert flown == Counter(SEEDS)
    assert len(env.resets) == max(num_envs, len(SEEDS))


def test_seeds_keep_the_order_they_were_given_in() -> None:
    order = [9, 2, 40, 7]
    assert fly(3, order).seeds == order


def test_the_policy_forgets_a_world_with_each_new_seed() -> None:
    policy = CraneExpert()
    fly(4, policy=policy)
    assert policy.resets == len(SEEDS)  # all four at the start, one per later seed


class Dicing(CraneExpert):
    """Misses the goal by as much as its dice say, which the seed of the episode decides."""

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        fresh = np.array([np.random.default_rng(seed).normal(size=2) for seed in seeds])
        self.missed = fresh if mask is None else np.where(mask[:, None], fresh, self.missed)

    def act(self, obs: Observation) -> np.ndarray:
        actions = super().act(obs)
        actions += 0.05 * self.missed
        return actions


def test_a_policy_with_dice_flies_alike_in_any_batch() -> None:
    alone, together = fly(1, policy=Dicing()), fly(7, policy=Dicing())
    assert [(e.seed, e.success, e.steps) for e in alone.episodes] == [
        (e.seed, e.success, e.steps) for e in together.episodes
    ]
    assert alone.success != fly(1, policy=CraneExpert()).success, "and the dice matter"


def test_an_episode_stops_at_its_first_success() -> None:
    for trace in rollouts(CraneBatch(4), CraneExpert(), SEEDS):
        if trace.success:
            assert trace.subtasks[-1].all()
            assert len(trace) < crane_spec().max_steps


def test_a_timeout_flies_every_step() -> None:
    lengths = [len(t) for t in rollouts(CraneBatch(4), CraneExpert(), SEEDS) if not t.success and not t.crash]
    assert lengths
    assert set(lengths) == {crane_spec().max_steps}


def test_phases_of_a_scripted_policy_are_kept() -> None:
    result = fly(4)
    flight = result.flights[next(e.seed for e in result.episodes if e.success)]
    assert flight.phase_names == CraneExpert.phase_names
    assert flight.phase is not None
    assert set(flight.phase.tolist()) == {0, 1}


def test_a_trained_policy_is_known_by_its_digest() -> None:
    def digest_of(weight: float) -> str:
        policy = CraneExpert()
        policy.to_checkpoint = lambda: Checkpoint({"weight": np.array([weight])}, {}, {"policy": "test"})
        return fly(1, [100], policy=policy).provenance["policy_sha256"]

    assert len(digest_of(1.0)) == 64
    assert digest_of(1.0) == digest_of(1.0) != digest_of(2.0)
    assert fly(1, [100]).provenance["policy_sha256"] is None


def test_a_policy_that_refuses_its_input_names_seed_and_step() -> None:
    policy = CraneExpert()
    original = policy.act

    def act(obs: Any) -> np.ndarray:
        if 3 in policy.env.steps:
            raise NonFiniteActionError("network output", [1])
        return original(obs)

    policy.act = act
    with pytest.raises(SimulationDivergedError, match=r"network output at step 3 .* seed 101"):
        fly(2, [100, 101], policy=policy)


class BreaksAt(CraneExpert):
    """Gives NaN for one goal at one step."""

    def __init__(self, seed: int, step: int) -> None:
        super().__init__()
        self.seed, self.step = seed, step

    def act(self, obs: Any) -> np.ndarray:
        actions = super().act(obs)
        actions[(self.env.seeds == self.seed) & (self.env.steps == self.step), 1] = np.nan
        return actions


@pytest.mark.parametrize("num_envs", [1, 5])
def test_nan_of_a_policy_names_seed_step_and_element(num_envs: int) -> None:
    with pytest.raises(SimulationDivergedError, match=r"'z'.* step 4 .* seed 117") as caught:
        fly(num_envs, policy=BreaksAt(seed=117, step=4))
    assert (caught.value.seed, caught.value.step) == (117, 4)


def test_nan_in_a_world_that_has_landed_disturbs_nobody() -> None:
    policy = CraneExpert()
    original = policy.act

    def act(obs: Any) -> np.ndarray:
        actions = original(obs)
        actions[2:] = np.nan  # only two seeds fly
        return actions

    policy.act = act
    assert len(fly(4, [100, 101], policy=policy).episodes) == 2


@pytest.mark.parametrize(
    ("seeds", "message"),
    [([], "no seeds"), ([4, 5, 4], "Seed 4 is given twice"), ([-1], "Seed -1 is negative")],
)
def test_bad_seeds_are_refused(seeds: list[int], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        fly(2, seeds)


def test_actions_of_the_wrong_shape_are_refused() -> None:
    policy = CraneExpert()
    policy.act = lambda obs: np.zeros((2, 7))
    with pytest.raises(InvalidValueError, match=r"\(2, 7\).*\(2, 2\)"):
        fly(2, policy=policy)
