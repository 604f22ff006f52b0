"""A folder of several tasks: learned from evenly, flown on the way and filmed in each of them."""

import json
import shlex
import shutil
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core import language
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ObservationSpec
from aerial_il.evaluation.result import load_result
from aerial_il.evaluation.training_run import read_run
from aerial_il.policies import load_flying
from aerial_il.policies.parts.language import TOLD
from aerial_il.policies.parts.tasks import wordings_of
from aerial_il.suite import tasks
from aerial_il.workflows.parts import demonstrations, run_results
from tests.links.test_fly import fresh_policy

QUIET = "progress=false"
TASKS = ("press_button", "reach")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with demonstrations of two tasks, and one that holds the same task twice."""
    folder = tmp_path_factory.mktemp("tasks")
    for task in TASKS:
        assert main(["collect", f"task={task}", "episodes=2", f"out={folder / 'both' / task}", QUIET]) == 0
    more = ["task=reach", "seed=2", "episodes=1", f"out={folder / 'reach' / 'b'}"]
    shutil.copytree(folder / "both" / "reach", folder / "reach" / "a")
    assert main(["collect", *more, QUIET]) == 0
    return folder


@pytest.fixture(scope="module")
def run(home: Path) -> Path:
    """A policy for both tasks, flown while it learned."""
    words = ["dataset.episodes=2", "policy.hidden=[8]", "algorithm.steps=2", "evaluate_every=2", "evaluate_episodes=3"]
    assert main(["train", f"dataset={home / 'both'}", *words, f"run={home / 'run'}", QUIET]) == 0
    return home / "run"


def test_it_is_flown_in_each_of_its_tasks_while_it_learns(run: Path) -> None:
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    flown = [row for row in rows if "evaluate/success" in row]
    (row,) = flown
    each = [row[f"evaluate/success/{task}"] for task in TASKS]
    assert row["evaluate/success"] == pytest.approx(sum(each) / 2)
    assert row["evaluate/episodes"] == 4, "three flights are shared among two tasks, rounded up"


@pytest.mark.render
@pytest.mark.slow
def test_its_report_shows_a_flight_of_each_of_its_tasks(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_results, "FLOWN", 1)
    footage = run_results.footage(read_run(run), 1)
    assert (footage.note, [clip.path.parent.name for clip in footage.clips]) == ("", list(TASKS))
    assert all(clip.path.stat().st_size for clip in footage.clips)


def test_a_few_demonstrations_are_taken_evenly_from_all_tasks(home: Path) -> None:
    chosen = list(demonstrations.open_demonstrations(str(home / "both"), limit=4))
    assert [episode.spec.task for episode in chosen] == [*TASKS, *TASKS]
    assert [episode.provenance["seed"] for episode in chosen] == [0, 0, 1, 1]
    with pytest.raises(InvalidValueError, match="has 4 successful demonstrations"):
        demonstrations.open_demonstrations(str(home / "both"), limit=5)


def test_folders_of_one_task_are_taken_one_after_the_other(home: Path) -> None:
    chosen = list(demonstrations.open_demonstrations(str(home / "reach"), limit=3))
    assert [episode.provenance["seed"] for episode in chosen] == [0, 1, 2]


def test_a_policy_is_told_in_words_what_to_do(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It has no number of a task; what it is told decides what it does, and is kept with the result."""
    words = ["dataset.language=true", "policy.hidden=[8]", "algorithm.steps=2"]
    assert main(["train", f"dataset={home / 'both'}", *words, f"run={home / 'worded'}", QUIET]) == 0
    policy = load_flying(home / "worded")
    assert "task_id" not in policy.spec.observation.names
    assert policy.interface.layout.size >= language.SIZE
    flown = {}
    for name, told in {"own": [], "other": ["instruction=按下红色按钮。"]}.items():
        out = home / "told" / name
        asked = [f"policy={home / 'worded'}", "task=reach", "episodes=2", "videos=0", QUIET]
        assert main(["evaluate", *asked, *told, f"out={out}"]) == 0
        flown[name] = load_result(out)
    assert flown["own"].provenance["environment"]["instruction"].startswith("Bring the gripper")
    assert flown["other"].provenance["environment"]["instruction"] == "按下红色按钮。"
    assert flown["own"].episodes != flown["other"].episodes
    again = [f"again={home / 'told' / 'other'}", f"out={home / 'told' / 'again'}", "videos=0", QUIET]
    assert main(["evaluate", *again]) == 0
    assert "2 of 2 flights are equal" in capsys.readouterr().out


@pytest.fixture(scope="module")
def worded(home: Path) -> Path:
    """A policy for both tasks that is told in words."""
    words = ["dataset.language=true", "policy.hidden=[8]", "algorithm.steps=2"]
    assert main(["train", f"dataset={home / 'both'}", *words, f"run={home / 'other'}", QUIET]) == 0
    return home / "other"


def test_other_words_are_taken_for_the_nearest_that_it_learned_from(
    worded: Path, caplog: pytest.LogCaptureFixture
) -> None:
    policy, other = load_flying(worded), load_flying(worded)
    known = [*wordings_of(policy.spec)]
    assert len(known) == sum(1 + len(tasks.get(task).wordings) for task in TASKS), "all of each task"
    with closing(aerial_il.load_batch("ua_quad_arm4", "press_button", num_envs=1)) as env:
        obs = env.reset(np.array([0]))
        for each in (policy, other):
            each.attach(env)
        policy.told, other.told = known[-1], f"Kindly {known[-1]} Now!"
        np.testing.assert_array_equal(policy.act(obs), other.act(obs))
        assert f"as {known[-1]!r}" in caplog.text
        caplog.clear()
        policy.reset()
        policy.told = tasks.get("press_button").instruction  # the other was of reach
        policy.reset()
        other.reset()
        assert np.any(policy.act(obs) != other.act(obs))
        assert not caplog.text, "what was learned from needs no word"


def test_a_result_says_what_an_instruction_was_taken_for(worded: Path, tmp_path: Path) -> None:
    known = next(iter(wordings_of(load_flying(worded).spec)))
    asked = [f"policy={worded}", "task=reach", "episodes=1", "videos=0", f"out={tmp_path / 'out'}", QUIET]
    assert main(["evaluate", *asked, f"instruction={known} Now!"]) == 0
    provenance = load_result(tmp_path / "out").provenance
    told = provenance["environment"]
    assert f"instruction={known} Now!" in shlex.split(provenance["command"]), "typed again it is the same"
    assert (told["instruction"], told["understood"]) == (f"{known} Now!", known)


def test_before_it_is_told_anything_it_does_not_act(worded: Path) -> None:
    policy = load_flying(worded)
    with closing(aerial_il.load_batch("ua_quad_arm4", "press_button", num_envs=1)) as env:
        obs = env.reset(np.array([0]))
        policy.task = "press_button"
        with pytest.raises(InvalidValueError, match="set its `told`, or attach it first"):
            policy.act(obs)
        policy.told = next(iter(wordings_of(policy.spec)))
        policy.act(obs)


def test_a_policy_that_kept_one_line_is_told_anything() -> None:
    """Before wordings were kept, the instruction of the task stood there, whatever had been learned from."""
    with closing(aerial_il.load_batch("ua_quad_arm4", "press_button", num_envs=1)) as env:
        spec = replace(env.spec, observation=ObservationSpec((*env.spec.observation.fields, TOLD)))
        policy = fresh_policy("mlp", spec=spec)
        policy.attach(env)
        policy.told = "按下红色按钮。"
        assert policy.understood == policy.told


def test_an_instruction_for_nothing_that_it_knows_is_refused(
    worded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [f"policy={worded}", "task=reach", "episodes=1", "videos=0", f"out={tmp_path / 'out'}", QUIET]
    assert main(["evaluate", *asked, "instruction=Make me a coffee."]) == 2
    shown = capsys.readouterr().err
    assert "'Make me a coffee.'" in shown
    assert "It knows, among others" in shown
    assert not (tmp_path / "out").exists()


def test_words_are_refused_by_a_policy_that_goes_by_numbers(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [f"policy={run}", "task=reach", "episodes=1", "instruction=Reach.", f"out={tmp_path / 'out'}", QUIET]
    assert main(["evaluate", *asked]) == 2
    assert "train one with dataset.language=true" in capsys.readouterr().err


@pytest.mark.parametrize("algorithm", ["dagger", "bc_ppo"])
def test_words_are_refused_by_algorithms_that_fly(
    algorithm: str, home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [f"algorithm={algorithm}", f"dataset={home / 'reach'}", "dataset.language=true", f"run={tmp_path / 'run'}"]
    assert main(["train", *asked, QUIET]) == 2
    assert f"nobody tells {algorithm} in words" in capsys.readouterr().err


def test_runs_with_words_and_without_are_two_methods(home: Path, tmp_path: Path) -> None:
    for worded in ("true", "false"):
        run = tmp_path / worded
        words = [f"dataset.language={worded}", "policy.hidden=[8]", "algorithm.steps=2", QUIET]
        assert main(["train", f"dataset={home / 'reach'}", *words, f"run={run}"]) == 0
    told, plain = (read_run(tmp_path / worded).settings for worded in ("true", "false"))
    assert told.pop("dataset.language") is True
    assert told == plain


def test_an_error_says_how_episodes_are_given_words(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = shutil.copytree(home / "both" / "reach", tmp_path / "reach")
    where = "where=\"task == 'reach'\""
    train = ["train", f"dataset={own}", "dataset.language=true", "policy.hidden=[8]", "algorithm.steps=2", QUIET]
    assert main(["relabel", str(own), where.replace('"', ""), "instruction='...'", QUIET]) == 0
    assert main([*train, f"run={tmp_path / 'run'}"]) == 2
    assert f"aerial-il relabel DATASET {where} instruction=" in capsys.readouterr().err
    assert main(["relabel", str(own), where.replace('"', ""), "instruction='Fly to the mark'", QUIET]) == 0
    assert main([*train, f"run={tmp_path / 'run'}"]) == 0


@pytest.mark.parametrize(
    ("algorithm", "settings"),
    [
        ("filtered_bc", ["rounds=1", "episodes=2", "between_steps=2", "training.steps=2", "training.validation=0"]),
        ("residual", ["steps=200", "rollout.steps=64", "rollout.epochs=1"]),
    ],
)
def test_a_prior_of_several_tasks_flies_or_is_refused_before_anything_is_flown(
    run: Path, home: Path, tmp_path: Path, algorithm: str, settings: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    words = [f"dataset={home / 'reach'}", f"algorithm={algorithm}", f"algorithm.prior={run}", "num_envs=2", QUIET]
    code = main(["train", *words, *(f"algorithm.{word}" for word in settings), f"run={tmp_path / 'on'}"])
    said = capsys.readouterr().err
    if algorithm == "filtered_bc":
        assert "Unknown" not in said, "it knows which of its tasks it flies"
        return
    assert code == 2
    assert f"The prior {run} flies several tasks" in said
