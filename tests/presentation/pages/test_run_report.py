"""The page of a run, and that of several, tell what the runs did and hide no seed."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.predictions import Prediction
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.run_collection import axes_of
from aerial_il.evaluation.statistics import bootstrap_macro, wilson
from aerial_il.evaluation.training_run import find_runs, read_run
from aerial_il.presentation.films.video import Footage
from aerial_il.presentation.pages import run_figures
from aerial_il.presentation.pages.run_report import grouped, write_run_report, write_runs_report
from tests.presentation.outline import Outline, needs_nothing_else

RATES = (0.1, 0.6, 0.8, 0.7)


def make_run(folder: Path, *, seed: int = 0, rates: tuple[float, ...] = RATES, **settings: Any) -> Path:
    policy = {"name": "mlp", "chunk": settings.pop("chunk", 10)}
    data = {"demonstrations": 80, "frames": 8000 + seed, "digest": f"{seed}"}
    config = {"algorithm": "bc", "seed": seed, "dataset": data, "settings": {"lr": 0.001, **settings}, "policy": policy}
    rows: list[dict[str, float]] = []
    for k, rate in enumerate(rates, start=1):
        logged = {"loss": 1 / k, "lr": 1e-3, "elapsed_s": 9.0 * k}
        rows.append({"step": 100 * k, **logged, "validation/loss": 1.2 / k, "validation/x": 0.1 / k})
        rows.append({"step": 100 * k, "evaluate/success": rate, "evaluate/episodes": 20})
    make_other(folder, config, rows)
    (folder / "provenance.json").write_text('{"git": {"sha": "abc"}}')
    (folder / "policy").mkdir()
    return folder


def make_other(folder: Path, config: dict[str, Any], rows: list[dict[str, float]]) -> Path:
    """Leave what a run of another algorithm leaves."""
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def make_dagger(folder: Path) -> Path:
    names = ("queries", "interventions", "beta", "noise", "total/queries", "total/episodes")
    rows = [{"step": k, **{name: float(k + 1) for name in names}, "evaluate/success": 0.25 * k} for k in range(4)]
    config = {"algorithm": "dagger", "environment": {"task": "reach"}, "settings": {"rounds": 3}}
    return make_other(folder, config, rows)


ADVERSARIAL = (
    *("reward/loss", "reward/acc_expert", "reward/acc_agent", "reward/gradient_penalty", "reward/mean"),
    *("actor/loss", "actor/entropy", "actor/alpha", "critic/loss", "critic/value"),
    *("episode/return", "episode/length", "episode/success", "episode/count", "of/another/kind"),
)


def make_adversarial(
    folder: Path, *, seed: int = 0, rewards: tuple[float, ...] = (0.5, 1.5, 3.0), transitions: int = 100
) -> Path:
    data = {"demonstrations": 4, "transitions": transitions, "digest": f"{seed}"}
    origin = {"algorithm": "dac", "seed": seed, "environment": {"task": "Hopper-v5"}, "dataset": data}
    rows: list[dict[str, float]] = []
    for k, reward in enumerate(rewards, start=1):
        rows.append({"step": 5000 * k, **dict.fromkeys(ADVERSARIAL, 1.0 / k), "elapsed_s": 3.0 * k})
        flown = {"success": 0.0, "mean_reward": reward, "time_to_success_s": float("nan"), "crashes": 0.1 * k}
        rows.append({"step": 5000 * k, **{f"evaluate/{name}": value for name, value in flown.items()}})
    policy = {"name": "squashed_gaussian"}
    return make_other(folder, {**origin, "settings": {"subsample": 20}, "policy": policy}, rows)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return make_run(tmp_path / "run")


def test_the_page_of_a_run_has_every_section(run: Path, diver: EvaluationResult) -> None:
    diver.save(run / "evaluation")
    shown = Prediction(
        uid="demo-3",
        labels=("x", "gripper"),
        units=("m", ""),
        time_s=np.arange(30) * 0.02,
        shown=np.zeros((30, 2)),
        predicted=np.full((30, 2), 0.25),
        starts=np.arange(0, 30, 10),
    )
    page = write_run_report(run / "r.html", read_run(run), predictions=[shown], footage=Footage(note="No films: <why>"))
    html = page.read_text()
    assert needs_nothing_else(html)
    sections = ("judged", "rollouts", "loss", "metrics", "validation", "predictions", "films", "origin")
    assert tuple(Outline(html).ids) == sections
    assert "Best 80 % at step 300, final 70 %" in html
    assert "Mean absolute error 0.25 m" in html
    assert f"<b>{diver.success['count']} of 40</b>" in html
    assert "No films: &lt;why&gt;" in html
    assert html.count('class="trace hue1"') == 2 * 3 + 1, "three chunks of two elements, and the loss on held-out data"


def test_a_run_without_rollouts_or_validation_still_reads(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", rates=())
    (run / "metrics.jsonl").write_text('{"step": 10, "loss": 1.0}\n{"step": 20, "loss": 0.5}\n{"step": 30, "lo')
    (run / "policy").rmdir()
    html = write_run_report(tmp_path / "r.html", read_run(run), prediction_note="No predictions: why").read_text()
    assert Outline(html).ids == ["loss", "predictions", "origin"]
    assert "not finished" in html


def test_every_logged_number_of_any_algorithm_is_drawn(tmp_path: Path) -> None:
    run = read_run(make_adversarial(tmp_path / "dac"))
    groups = {heading: [figure.title for figure in figures] for heading, figures in run_figures.others(run).items()}
    assert groups["Actor"] == ["Loss", "Entropy", "Alpha"]
    assert groups["Rollouts on the way"] == ["Crashes"]
    assert groups["Of, another"] == ["Kind"]
    assert sum(map(len, groups.values())) == len(ADVERSARIAL) + 1
    html = write_run_report(tmp_path / "dac.html", run).read_text()
    assert needs_nothing_else(html)
    assert Outline(html).ids == ["rollouts", "metrics", "origin"]
    for name in (*ADVERSARIAL, "evaluate/crashes"):
        assert f'aria-label="{name} over 15000 environment steps' in html


@pytest.mark.parametrize("values", [(3.0, -6.0), (-2.0, -6.0), (-6.0, 3.0)])
def test_a_negative_log_likelihood_is_drawn_whole(tmp_path: Path, values: tuple[float, ...]) -> None:
    """One that falls below zero stays in the picture, whose y grows downwards."""
    rows = [{"step": float(k), "loss": value} for k, value in enumerate(values)]
    run = read_run(make_other(tmp_path / "run", {"algorithm": "bc"}, rows))
    figure = run_figures.losses({"it": [run]})
    assert figure is not None
    _, top, _, height = map(float, re.findall(r'class="data".*?viewBox="([^"]+)"', figure.svg)[0].split())
    points = re.findall(r'points="([^"]+)"', figure.svg)[0].split()
    assert all(top <= float(point.split(",")[1]) <= top + height for point in points)


def test_what_dagger_asks_is_drawn_over_rounds(tmp_path: Path) -> None:
    html = write_run_report(tmp_path / "dagger.html", read_run(make_dagger(tmp_path / "run"))).read_text()
    assert Outline(html).ids == ["rollouts", "metrics", "origin"]
    for name in ("queries", "interventions", "beta", "noise", "total/queries", "total/episodes"):
        assert f'aria-label="{name} over 3 rounds' in html
    assert "Best 75 % at round 3, final 75 %" in html


@pytest.mark.parametrize(
    ("make", "unit"), [(make_run, "training step"), (make_dagger, "round"), (make_adversarial, "environment step")]
)
def test_the_axis_says_what_the_steps_count(tmp_path: Path, make: Any, unit: str) -> None:
    run = read_run(make(tmp_path / "run"))
    assert run.unit == unit
    told = {"training step", "round", "environment step"}
    for page in (write_run_report(tmp_path / "one.html", run), write_runs_report(tmp_path / "all.html", [run])):
        html = page.read_text()
        assert {axis for axis in told if f">{axis}</text>" in html} == {unit}
    dagger = read_run(make_dagger(tmp_path / "other"))
    assert run_figures.unit_of([run, dagger]) == {"round": "round"}.get(unit, " or ".join(sorted(["round", unit])))


def test_the_mean_reward_is_drawn_beside_success(tmp_path: Path) -> None:
    run = read_run(make_adversarial(tmp_path / "run"))
    assert run.rewards == [(5000, 0.5), (10000, 1.5), (15000, 3.0)]
    html = write_run_report(tmp_path / "one.html", run).read_text()
    assert "Mean reward over training: 3 at the end" in html
    assert html.count('class="spot hue0"') == 3 + 3
    seeds = [read_run(make_adversarial(tmp_path / f"{k}", seed=k, rewards=(1.0, k + 1.0))) for k in range(3)]
    (step, same, alike), (_, mean, apart) = run_figures.mean_rewards(seeds)
    assert (step, same, mean) == (5000.0, 1.0, 2.0)
    assert alike is not None
    assert apart is not None
    assert alike.hi - alike.lo == 0
    assert 1.0 <= apart.lo < 2.0 < apart.hi <= 3.0
    html = write_runs_report(tmp_path / "seeds.html", seeds).read_text()
    assert "Mean reward over training, mean over seeds: squashed_gaussian 2 at the end" in html
    assert html.count('class="trace thin') == 3 + 3, "every seed is drawn, its success and its reward"
    assert run_figures.mean_rewards(seeds[:1])[0][2] is None, "one seed tells nothing about others"


def test_the_learned_reward_is_drawn_along_a_demonstration(run: Path) -> None:
    paid = {"demo-<3>": {"as flown": np.linspace(0.0, 1.0, 9), "actions shuffled": np.zeros(9)}}
    html = write_run_report(run / "r.html", read_run(run), rewarded=paid).read_text()
    assert needs_nothing_else(html)
    assert "rewarded" in Outline(html).ids
    assert "Mean: as flown 0.5, actions shuffled 0." in html


def test_intervals_over_training_are_wilsons(run: Path) -> None:
    rollouts = read_run(run).rollouts
    assert [r.step for r in rollouts] == [100, 200, 300, 400]
    assert rollouts[1].ci95 == wilson(12, 20)


def make_from_prior(folder: Path, rates: dict[int, float]) -> Path:
    rows = [{"step": step, "evaluate/success": rate, "evaluate/episodes": 100} for step, rate in rates.items()]
    config = {"algorithm": "ppo", "environment": {"task": "reach"}, "settings": {"steps": 1000}}
    return make_other(folder, config, rows)


def test_the_largest_dip_is_below_the_prior(tmp_path: Path) -> None:
    dipped = read_run(make_from_prior(tmp_path / "dipped", {0: 0.5, 10: 0.1, 20: 0.2, 30: 0.42, 500: 0.9, 1000: 0.6}))
    assert dipped.largest_dip == pytest.approx(0.08), "what comes in the first 2 % of the steps does not count"
    html = write_run_report(tmp_path / "page.html", dipped).read_text()
    assert "Largest dip below the prior</dt><dd>8.0 points" in html
    assert read_run(make_from_prior(tmp_path / "risen", {0: 0.5, 500: 0.6, 1000: 0.9})).largest_dip == 0.0
    assert read_run(make_from_prior(tmp_path / "alone", {500: 0.6, 1000: 0.1})).largest_dip is None, (
        "no prior was flown"
    )
    assert read_run(make_from_prior(tmp_path / "begun", {0: 0.5})).largest_dip is None


def test_seeds_of_one_configuration_are_one_group(tmp_path: Path) -> None:
    runs = [make_run(tmp_path / f"a{seed}", seed=seed) for seed in range(3)]
    runs += [make_run(tmp_path / f"b{seed}", seed=seed, chunk=20, rates=(0.0, 0.2, 0.3, 0.4)) for seed in range(2)]
    groups = grouped([read_run(path) for path in runs])
    assert {label: [run.seed for run in members] for label, members in groups.items()} == {
        "chunk=10": [0, 1, 2],
        "chunk=20": [0, 1],
    }
    html = write_runs_report(tmp_path / "runs.html", [read_run(path) for path in runs]).read_text()
    assert needs_nothing_else(html)
    assert "5 runs, 2 configurations" in html
    assert html.count('class="trace thin') == 5, "every seed is drawn"


def test_the_mean_over_seeds_has_an_interval_of_both_levels(tmp_path: Path) -> None:
    alike = [read_run(make_run(tmp_path / f"a{seed}", seed=seed, rates=(0.5,))) for seed in range(3)]
    apart = [read_run(make_run(tmp_path / f"b{k}", seed=k, rates=(rate,))) for k, rate in enumerate((0.1, 0.5, 0.9))]
    ((_, mean, near),), ((_, same, far),) = run_figures.mean_success(alike), run_figures.mean_success(apart)
    assert mean == same == pytest.approx(0.5)
    assert near is not None
    assert far is not None
    assert far.hi - far.lo > 1.5 * (near.hi - near.lo), "policies that differ by seed are told with more doubt"
    assert near.lo < 0.5 < near.hi


def test_a_sweep_is_found_by_its_folder(tmp_path: Path) -> None:
    for seed in range(2):
        make_run(tmp_path / "sweep" / f"seed={seed}", seed=seed)
    (tmp_path / "sweep" / "other").mkdir()
    assert [path.name for path in find_runs(tmp_path / "sweep")] == ["seed=0", "seed=1"]
    assert find_runs(tmp_path / "sweep" / "seed=0") == [tmp_path / "sweep" / "seed=0"]
    assert find_runs(tmp_path / "nowhere") == []


def test_what_is_no_run_is_refused(run: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"not a training run.*aerial-il train"):
        read_run(run / "policy")
    with pytest.raises(InvalidValueError, match="given twice"):
        write_runs_report(run / "r.html", [read_run(run), read_run(run)])
    (run / "config.yaml").write_text("{")
    with pytest.raises(InvalidValueError, match=r"cannot be read as a training run"):
        read_run(run)


def test_the_mean_over_tasks_is_as_sure_as_its_episodes() -> None:
    few = bootstrap_macro([[5], [8]], 10, rng=np.random.default_rng(0))
    many = bootstrap_macro([[500], [800]], 1000, rng=np.random.default_rng(0))
    assert few.lo < 0.5 < 0.65 < few.hi < 0.9
    assert 0.62 < many.lo < 0.65 < many.hi < 0.68
    seeds = bootstrap_macro([[2, 8]], 10, rng=np.random.default_rng(0))
    assert seeds.hi - seeds.lo > 0.5, "training seeds that differ make the mean unsure"


def test_evaluations_that_were_flown_apart_are_not_averaged(tmp_path: Path, diver: EvaluationResult) -> None:
    runs = [make_run(tmp_path / f"{seed}", seed=seed) for seed in range(4)]
    flown = [diver, diver, replace(diver, tier="gusts"), replace(diver, task="land", episodes=diver.episodes[:30])]
    for run, result in zip(runs, flown, strict=True):
        result.save(run / "evaluation")
    html = write_runs_report(tmp_path / "r.html", [read_run(run) for run in runs]).read_text()
    cell = f"{diver.robot} {diver.task}"
    for seeds, said in ((2, f"{cell} {diver.tier}, 40"), (1, f"{cell} gusts, 40"), (1, f"{diver.robot} land")):
        assert re.search(rf"<td>{seeds}</td><td class=\"text\">evaluation, {re.escape(said)}", html), said


def test_rollouts_in_other_air_are_another_configuration_and_a_copy_counts_once(tmp_path: Path) -> None:
    runs = [make_run(tmp_path / f"{k}", seed=seed) for k, seed in enumerate((0, 1, 2, 2))]
    told = {"settings": {"evaluate_tier": "gusts", "evaluate_seed": 6000}, "dataset": {"reading": {"success": "all"}}}
    (runs[1] / "command.json").write_text(json.dumps(told))
    read = [read_run(run) for run in runs]
    assert [len(members) for members in grouped(read[:3]).values()] == [2, 1]
    assert {"evaluate_tier", "dataset.success"} <= {*axes_of(read)}
    html = write_runs_report(tmp_path / "r.html", read).read_text()
    assert f"{runs[2]} again: the same settings, seed and demonstrations" in html
    assert "3 runs, 2 configurations" in html


def test_what_other_weights_flew_is_marked(run: Path, diver: EvaluationResult) -> None:
    diver.save(run / "evaluation")
    for others in ((), ("evaluation",)):
        html = write_run_report(run / "r.html", read_run(run), flown_by_others=others).read_text()
        assert ("by other weights than the run has now" in html) == bool(others)
