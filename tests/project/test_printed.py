"""What a person prints fits a screen and says what it is."""

from pathlib import Path

import pytest

import aerial_il
from aerial_il import robots
from aerial_il.evaluation.compare import compare
from aerial_il.evaluation.run_collection import read_runs
from aerial_il.evaluation.training_run import read_run
from aerial_il.suite import tasks, tiers


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("printed") / "hover"
    aerial_il.collect(robot="quad", task="hover", episodes=1, out=out, progress=False)
    return out


def short(thing: object) -> str:
    """Return how ``thing`` is printed, which fits a screen and names no address."""
    said = repr(thing)
    assert len(said) < 600, said
    assert " at 0x" not in said
    return said


def test_objects_print_in_a_few_lines(flown: Path) -> None:
    dataset = aerial_il.open_dataset(flown)
    single, batch = aerial_il.load("quad", "hover"), aerial_il.load_batch("quad", "hover", num_envs=2)
    for thing in (dataset, dataset[0], dataset.spec, dataset.spec.observation, dataset.spec.action, single, batch):
        short(thing)
    assert "quad/hover" in repr(dataset[0])
    assert "2 worlds" in repr(batch)
    single.close()
    batch.close()


def test_results_and_runs_say_what_they_are(flown: Path, tmp_path: Path) -> None:
    words = {"steps": 3, "validation": 0.0}
    policy = aerial_il.train(flown, run=tmp_path / "run", algorithm=words, policy={"hidden": [8]}, progress=False)
    assert "mlp of quad/hover" in short(policy)
    result = aerial_il.evaluate("expert", out=tmp_path / "e", robot="quad", task="hover", episodes=2, videos=0)
    assert short(result).startswith("EvaluationResult(expert: quad/hover, calm, 2/2 = 100.0 %")
    other = aerial_il.evaluate(tmp_path / "run", out=tmp_path / "run" / "evaluation", episodes=2, videos=0)
    assert "expert 100.0 %" in short(compare(result, other))
    assert "mlp by bc, seed 0, 3 steps, finished" in short(read_run(tmp_path / "run"))
    assert "1 runs, 0 refused" in short(read_runs(tmp_path / "run"))


def test_what_flights_are_made_of_says_what_it_is() -> None:
    for robot, task in aerial_il.list_cells():
        assert "noise=0.0" in short(aerial_il.expert(robot, task))
    env = aerial_il.load("quad", "hover")
    for thing in (env.physics, env.task, *map(tasks.get, aerial_il.list_tasks()), *map(tiers.get, tiers.names())):
        short(thing)
    env.close()
    for robot in aerial_il.list_robots():
        assert " at 0x" not in repr(robots.get(robot))
    cart = aerial_il.load_gymnasium("CartPole-v1", num_envs=2)
    assert short(cart) == "OutsideBatch(gymnasium:CartPole-v1, 2 worlds)"
    cart.close()
