"""Headline seeds are reserved: nothing is tuned on them, and nothing else is judged."""

from typing import Any

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.cli.main import main
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError
from experiments.common.seeds import EVALUATION_SEED, check_distinct, check_seeds, check_untuned
from experiments.dagger.study import Dagger
from experiments.from_prior.study import FromPrior
from experiments.generation.study import Generation
from experiments.hg_dagger.study import HgDagger
from experiments.imitation.study import Imitation
from experiments.pixels.study import Pixels


@pytest.mark.parametrize(("seed", "episodes"), [(0, 10), (5_990, 20), (10_000, 10), (19_999, 2), (29_999, 2)])
def test_evaluations_on_other_seeds_are_refused(seed: int, episodes: int) -> None:
    with pytest.raises(InvalidValueError, match="from 20000 to 29999"):
        check_seeds(seed, episodes)
    check_seeds(5_000, 10)
    check_seeds(EVALUATION_SEED, 200)


@pytest.mark.parametrize(
    ("study", "changed", "named"),
    [
        (Imitation, {"algorithms": {**Imitation().algorithms, "mlp": BC(lr=1e-4)}}, "bench.algorithms.mlp"),
        (Dagger, {"cloning": BC(steps=500)}, "bench.cloning"),
        (Generation, {"noise": 0.7}, "bench.noise"),
        (HgDagger, {"rounds": 40}, "bench.rounds"),
        (Pixels, {"image_size": (96, 96)}, "bench.image_size"),
        (FromPrior, {"suited": {"insert_peg": {"dapg": {"gamma": 0.9}}}}, "bench.suited.insert_peg"),
    ],
)
def test_tuning_on_the_reserved_seeds_is_refused(study: Any, changed: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidValueError, match=f"{named} .* seeds 20000 on are reserved.*first_episode=5000"):
        check_untuned(study(**changed))
    check_untuned(study(**changed, first_episode=5_000))


def test_what_is_said_twice_is_refused() -> None:
    for said in ({"draws": (0, 1, 0)}, {"tasks": ("reach", "reach")}, {"flown_in": ("calm", "calm")}):
        with pytest.raises(InvalidValueError, match=f"bench.{next(iter(said))} has .* twice"):
            check_distinct(Imitation(**said))
    for name in registry.names("study"):
        check_distinct(registry.get("study", name)())


def test_fewer_draws_robots_and_flights_may_be_judged() -> None:
    check_untuned(Imitation(robots=("ua_quad_arm4",), tasks=("reach",), draws=(0,), episodes=10, num_envs=5))
    check_untuned(Generation(flights=10, few=5))
    check_untuned(FromPrior(starts={"pick_place": (10,)}, arms=("dapg",), draws=(7,)))


def test_the_command_refuses_before_anything_is_flown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "bench=dagger", "bench.cloning.lr=1e-4"]) == 2
    assert "bench.cloning differs from what is shipped" in capsys.readouterr().err
