"""Influence of demonstrations on a policy's flights: a linear policy, of which leaving one out is computed exactly."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from aerial_il.algorithms.supervised.influence import influence
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import ChunkNetwork, masked_mean
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from tests.algorithms.stateless_batch import episode_of

SPEC = EnvSpec(
    robot="point",
    task="follow",
    tier="calm",
    observation=ObservationSpec((Field("state", (3,)),)),
    action=ActionSpec("force", ("force",), ("N",), np.array([-50.0]), np.array([50.0])),
    control_dt_s=0.02,
    max_steps=60,
    instruction="Act as the law says.",
    subtasks=(),
    state_size=0,
)
LAW = np.array([1.0, -2.0, 0.5])
DEMOS, BAD, FLIGHTS, STEPS, SHAKE = 30, 8, 400, 10, 0.5
SETTINGS = MLP(chunk=1, ensemble=None, anchor=None, masked_fields=(), loss="l2")


class Linear(ChunkNetwork):
    """The action as a product of the state and three weights."""

    def __init__(self, weights: np.ndarray) -> None:
        super().__init__()
        self.weights = nn.Parameter(torch.tensor(weights, dtype=torch.float32))

    def forward(self, obs: Tensor) -> Tensor:
        return (obs[:, -1] @ self.weights)[:, None, None]

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return masked_mean((self(obs) - actions) ** 2, valid), {}


def policy_of(weights: np.ndarray) -> ChunkPolicy:
    layout, switches = Layout.of(SPEC, SETTINGS), Switches(*np.full((2, 1), np.nan, np.float32))
    interface = Interface(layout, Normaliser.none(3), Normaliser.none(1), 10.0, switches)
    return ChunkPolicy(SETTINGS, interface, Linear(weights))


def recorded(index: int, states: np.ndarray, actions: np.ndarray, *, success: bool = True) -> Episode:
    obs = {"state": np.concatenate([states, states[-1:]])}
    return replace(episode_of(SPEC, index, obs, actions[:, None]), success=success)


@dataclass(frozen=True, eq=False)
class Toy:
    """Demonstrations, of which the last ones contradict the others; their clone; its flights.

    Attributes:
        helped: (E,) by how much the clone's success falls when one of the demonstrations is left out.
    """

    demos: list[Episode]
    clone: ChunkPolicy
    flights: list[Episode]
    helped: np.ndarray


def fitted(demos: Sequence[Episode]) -> np.ndarray:
    """Return the weights (3,) with the smallest squares."""
    states = np.concatenate([each.obs["state"][:-1] for each in demos])
    return np.linalg.lstsq(states, np.concatenate([each.actions[:, 0] for each in demos]), rcond=None)[0]


def succeeds(states: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Return whether actions (N, T) in states (N, T, 3) are near the law's, (N,) bool."""
    return np.mean((actions - states @ LAW) ** 2, axis=1) < 2.0


@pytest.fixture(scope="module")
def toy() -> Toy:
    rng = np.random.default_rng(0)
    demos = []
    for i, length in enumerate(rng.integers(5, 50, DEMOS)):
        states, law = rng.normal(size=(length, 3)), -LAW if i >= DEMOS - BAD else LAW
        demos.append(recorded(i, states, states @ law + 0.3 * rng.normal(size=length)))
    weights, states = fitted(demos), rng.normal(size=(FLIGHTS, STEPS, 3))
    actions = states @ weights + SHAKE * rng.normal(size=(FLIGHTS, STEPS))
    won = succeeds(states, actions)
    flown = enumerate(zip(states, actions, won.tolist(), strict=True))
    flights = [recorded(i, seen, done, success=each) for i, (seen, done, each) in flown]
    tried, shaken = rng.normal(size=(20_000, STEPS, 3)), SHAKE * rng.normal(size=(20_000, STEPS))

    def success(weights: np.ndarray) -> float:
        return float(succeeds(tried, tried @ weights + shaken).mean())

    left_out = [success(fitted([*demos[:i], *demos[i + 1 :]])) for i in range(DEMOS)]
    return Toy(demos, policy_of(weights), flights, success(weights) - np.array(left_out))


def agreement(scores: Sequence[float] | np.ndarray, toy: Toy) -> float:
    """Return the rank correlation of scores with what leaving each demonstration out has shown."""
    return float(np.corrcoef(np.argsort(np.argsort(scores)), np.argsort(np.argsort(toy.helped)))[0, 1])


def test_it_ranks_demonstrations_as_leaving_each_out_does(toy: Toy) -> None:
    scores = influence(toy.clone, toy.demos, toy.flights, output="likelihood")
    assert list(scores) == [demo.uid for demo in toy.demos]
    assert agreement([scores[demo.uid] * len(demo) for demo in toy.demos], toy) > 0.9
    assert [score < 0.0 for score in scores.values()] == [i >= DEMOS - BAD for i in range(DEMOS)]


def test_to_count_steps_is_not_enough(toy: Toy) -> None:
    lengths = np.array([len(demo) for demo in toy.demos])
    assert abs(agreement(lengths, toy)) < 0.6
    shortest = {*np.argsort(lengths)[:BAD]}, {*np.argsort(-lengths)[:BAD]}
    assert all(len(found & {*range(DEMOS - BAD, DEMOS)}) <= BAD // 2 for found in shortest)
    lost = [replace(flight, success=not flight.success) for flight in toy.flights]
    scores = influence(toy.clone, toy.demos, lost, output="likelihood")
    assert agreement([*scores.values()], toy) < -0.6, "it goes by success"


def test_square_counts_where_a_demonstration_was_flown_and_not_what_was_done_there(toy: Toy) -> None:
    rng = np.random.default_rng(1)

    def near(place: float, index: int, length: int, *, success: bool) -> Episode:
        states = rng.normal((place, 1.0, -place), 0.2, (length, 3))
        return recorded(index, states, states @ LAW, success=success)

    flights = [near(place, i, 20, success=place > 0.0) for place in (1.0, -1.0) for i in range(10)]
    demos = [near(-1.0 if i % 2 else 1.0, i, int(rng.integers(5, 50)), success=True) for i in range(20)]
    scores = influence(toy.clone, demos, flights)
    assert [score < 0.0 for score in scores.values()] == [bool(i % 2) for i in range(20)]
    turned = [replace(demo, executed_actions=-demo.executed_actions) for demo in demos]
    assert influence(toy.clone, turned, flights) == scores, "a contradiction in the same states is not seen"


def test_it_is_the_same_every_time(toy: Toy) -> None:
    first = influence(toy.clone, toy.demos, toy.flights)
    torch.rand(3)
    assert influence(toy.clone, iter(toy.demos), iter(toy.flights)) == first


@pytest.mark.parametrize("won", [True, False])
def test_without_contrast_it_is_refused(toy: Toy, won: bool) -> None:
    alike = [flight for flight in toy.flights if flight.success == won]
    with pytest.raises(InvalidValueError, match=f"All {len(alike)} flights {'succeed' if won else 'fail'}.*aerial-il"):
        influence(toy.clone, toy.demos, alike)


def test_flights_of_another_task_are_refused(toy: Toy) -> None:
    elsewhere = [replace(flight, spec=replace(SPEC, task="perch")) for flight in toy.flights[:2]]
    with pytest.raises(InvalidValueError, match="task: 'follow' != 'perch'"):
        influence(toy.clone, toy.demos, elsewhere)


def test_a_policy_that_draws_its_actions_is_refused_by_name(toy: Toy) -> None:
    drawing = policy_of(LAW)
    drawing.network.noise_size = 1
    with pytest.raises(InvalidValueError, match=r"policy=mlp draws what it flies.*gaussian"):
        influence(drawing, toy.demos, toy.flights)
