"""TD3+BC: one new file, nothing edited, and the contract of algorithms is kept."""

import inspect
from collections.abc import Callable, Iterator

import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.core.errors import UnknownNameError
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.made import made
from tests.contract import test_algorithms
from tests.contract.test_algorithms import cell  # noqa: F401 - a fixture that one of its tests takes
from tests.examples import plugged_in
from tests.examples.td3_bc import TD3BC, CloningAgent

NAME = "td3_bc"
CONTRACT = [
    test
    for test in vars(test_algorithms).values()
    if inspect.isfunction(test) and test.__name__.startswith("test_") and "name" in inspect.signature(test).parameters
]


@pytest.fixture(scope="module", autouse=True)
def added() -> Iterator[None]:
    with plugged_in({"algorithm": {NAME: "tests.examples.td3_bc"}}):
        yield


def test_it_is_known_by_its_name_while_it_is_installed() -> None:
    assert NAME in algorithms.names()
    assert algorithms.get(NAME) is TD3BC
    with pytest.raises(UnknownNameError, match=NAME):
        algorithms.get("td3bc")


@pytest.mark.parametrize("test", CONTRACT, ids=lambda test: test.__name__)
def test_it_keeps_the_contract(test: Callable[..., None], request: pytest.FixtureRequest) -> None:
    others = [name for name in inspect.signature(test).parameters if name != "name"]
    test(name=NAME, **{name: request.getfixturevalue(name) for name in others})


def test_the_actor_stays_near_unless_values_weigh_more() -> None:
    apart = []
    for alpha in (1e-3, 30.0):
        torch.manual_seed(0)
        settings = made(TD3BC, {"alpha": alpha, "critic_hidden": (8,), "lr": 1e-2})
        agent = CloningAgent(settings, SquashedGaussian(hidden=(16,)).build(2, 1), (2, 1))
        obs = torch.cat([torch.randn(64, 2), torch.zeros(64, 1)], dim=1)
        batch = Batch(obs, torch.full((64, 1), 0.3), obs, torch.zeros(64), torch.ones(64))
        for _ in range(100):
            agent.actor_state.descend(agent.actor_loss(batch))
        apart.append(((agent.actor(obs[:, None, :2])[:, 0] - batch.actions) ** 2).mean().item())
    assert apart[0] < 0.01 < apart[1]
