"""Schedule, averaged weights and optimiser state behave as documented, and the best weights are handed over."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.algorithms.run.train_state import adamw, from_arrays, to_arrays
from aerial_il.algorithms.supervised.learner import Learner, cosine
from aerial_il.algorithms.supervised.supervised_run import BestCheckpoint
from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from tests.algorithms.point_mass import demonstrations

POLICY = MLP(hidden=(16,), masked_fields=())
CADENCE = Cadence(log_every=20, evaluate_every=10, checkpoint_every=1000, keep_checkpoints=3)
UNJUDGED = replace(CADENCE, evaluate_every=0)
SETTINGS = BC(steps=60, batch_size=16, validate_every=0, cadence=CADENCE)


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    return demonstrations(4)


class Judge:
    """Gives success by a list, one number per evaluation, and may be stopped at one of them."""

    def __init__(self, rates: Sequence[float], *, stop_at: int | None = None) -> None:
        self.rates, self.stop_at, self.asked = rates, stop_at, list[int]()

    def __call__(self, policy: Any, step: int) -> dict[str, float]:
        if step == self.stop_at:
            raise KeyboardInterrupt
        self.asked.append(step)
        return {"success": self.rates[step // 10 - 1], "episodes": 20}


def learn(demos: list[Episode], run: Path, judge: Any, settings: BC = SETTINGS) -> Any:
    return settings.train(demos, POLICY, run=run, evaluate=judge, progress=False)


def weights(policy: Any) -> list[torch.Tensor]:
    return list(policy.network.state_dict().values())


def test_the_best_policy_is_kept_beside_the_final_one(demos: list[Episode], tmp_path: Path) -> None:
    final = learn(demos, tmp_path, Judge([0.2, 0.7, 0.5, 0.7, 0.1, 0.3]))
    best = load_policy(tmp_path / "best")
    assert best.origin["step"] == 40, "of equally good ones the later"
    assert best.origin["chosen"] == {"by": "success", "value": 0.7, "evaluations": 4}
    loaded = load_policy(tmp_path)
    assert loaded.origin["step"] == 60
    assert "chosen" not in loaded.origin
    assert all(torch.equal(a, b) for a, b in zip(weights(loaded), weights(final), strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(weights(best), weights(final), strict=True))


def test_a_run_that_no_longer_improves_ends(demos: list[Episode], tmp_path: Path) -> None:
    judge = Judge([0.2, 0.6, 0.6, 0.1, 0.9, 0.9])
    policy = learn(demos, tmp_path, judge, replace(SETTINGS, patience=2))
    assert judge.asked == [10, 20, 30, 40]
    assert policy.origin["step"] == 40
    assert load_policy(tmp_path).origin["step"] == 40
    assert load_policy(tmp_path / "best").origin["step"] == 30
    assert learn(demos, tmp_path, None, replace(SETTINGS, patience=2)).origin["step"] == 40, "it is finished"


def test_a_stopped_run_decides_as_an_undisturbed_one(demos: list[Episode], tmp_path: Path) -> None:
    rates, settings = [0.2, 0.6, 0.6, 0.1, 0.9, 0.9], replace(SETTINGS, patience=2)
    with pytest.raises(KeyboardInterrupt):
        learn(demos, tmp_path / "a", Judge(rates, stop_at=30), settings)
    stopped, whole = (
        learn(demos, tmp_path / "a", Judge(rates), settings),
        learn(demos, tmp_path / "b", Judge(rates), settings),
    )
    assert stopped.origin["step"] == whole.origin["step"] == 40
    for name in ("policy", "best"):
        files = [(tmp_path / run / name / "arrays.safetensors").read_bytes() for run in ("a", "b")]
        assert files[0] == files[1]


def test_rollouts_without_the_number_to_judge_by(demos: list[Episode], tmp_path: Path) -> None:
    def told(policy: Any, step: int) -> dict[str, float]:
        return {"return": 1.0 * step}

    learn(demos, tmp_path / "a", told)
    assert not (tmp_path / "a" / "best").exists()
    learn(demos, tmp_path / "b", told, replace(SETTINGS, best_by="return"))
    assert load_policy(tmp_path / "b" / "best").origin["step"] == 60
    with pytest.raises(InvalidValueError, match=r"'success'.*best_by"):
        learn(demos, tmp_path / "c", told, replace(SETTINGS, patience=1))
    with pytest.raises(InvalidValueError, match=r"'sucess'.*best_by"):
        learn(demos, tmp_path / "d", told, replace(SETTINGS, best_by="sucess"))


def test_an_evaluation_without_a_success_has_no_time_and_counts_as_the_worst(
    demos: list[Episode], tmp_path: Path
) -> None:
    times = {10: math.nan, 20: math.nan, 30: 5.0, 40: math.nan, 50: 6.0, 60: math.nan}

    def told(policy: Any, step: int) -> dict[str, float]:
        return {"success": float(math.isfinite(times[step])), "time_to_success_s": times[step]}

    learn(demos, tmp_path / "a", told, replace(SETTINGS, best_by="time_to_success_s"))
    assert load_policy(tmp_path / "a" / "best").origin["chosen"] == {
        "by": "time_to_success_s", "value": 5.0, "evaluations": 3
    }  # fmt: skip
    stopped = learn(demos, tmp_path / "b", told, replace(SETTINGS, best_by="time_to_success_s", patience=2))
    assert stopped.origin["step"] == 50, "two evaluations after the best were no better"
    settings = replace(SETTINGS, best_by="time_to_success_s")
    never = learn(demos, tmp_path / "c", lambda policy, step: told(policy, 10), settings)
    assert never.origin["step"] == 60
    assert not (tmp_path / "c" / "best").exists()


def test_starting_over_forgets_the_best(demos: list[Episode], tmp_path: Path) -> None:
    learn(demos, tmp_path, Judge([0.9] * 6))
    SETTINGS.train(demos, POLICY, run=tmp_path, progress=False, resume=False)
    assert not (tmp_path / "best").exists()


@pytest.mark.parametrize(
    "device",
    ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU"))],
)
def test_mixed_precision_learns_as_well(device: str, demos: list[Episode], tmp_path: Path) -> None:
    losses = []
    for name, mixed in (("a", False), ("b", True)):
        settings = replace(SETTINGS, cadence=UNJUDGED, device=device, mixed_precision=mixed)
        policy = settings.train(demos, POLICY, run=tmp_path / name, progress=False)
        assert {weight.dtype for weight in policy.network.state_dict().values()} == {torch.float32}
        losses.append([row["loss"] for row in read_metrics(tmp_path / name)])
    assert losses[0] != losses[1]
    assert losses[1][-1] < losses[1][0]
    assert losses[1][-1] == pytest.approx(losses[0][-1], rel=0.1)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_missing_gpu_is_named(demos: list[Episode], tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"device=gpu is none that torch knows\. Use cpu, cuda"):
        replace(SETTINGS, device="gpu").train(demos, POLICY, run=tmp_path / "gpu", progress=False)
    with pytest.raises(InvalidValueError, match=r"device=cuda needs a GPU.*device=cpu"):
        replace(SETTINGS, device="cuda").train(demos, POLICY, run=tmp_path / "cuda", progress=False)


def test_how_often_a_patient_run_is_judged_is_part_of_it(demos: list[Episode], tmp_path: Path) -> None:
    patient, rates = replace(SETTINGS, patience=4), [0.1] * 12
    with pytest.raises(KeyboardInterrupt):
        learn(demos, tmp_path, Judge(rates, stop_at=20), patient)
    with pytest.raises(InvalidValueError, match="evaluate_every"):
        learn(demos, tmp_path, Judge(rates), replace(patient, cadence=replace(CADENCE, evaluate_every=20)))


def test_patience_needs_rollouts_and_cameras_can_be_asked_for(demos: list[Episode], tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="evaluate_every"):
        BC(patience=3)
    with pytest.raises(InvalidValueError, match="cameras=scene_rgb; cameras=wrist_rgb was asked for"):
        SETTINGS.train(demos, POLICY, run=tmp_path, expect={"cameras": "wrist_rgb"})


def test_a_policy_without_its_statistics_is_refused(demos: list[Episode], tmp_path: Path) -> None:
    saved = replace(SETTINGS, steps=1).train(demos, POLICY, run=tmp_path / "run", progress=False).to_checkpoint()
    arrays = {name: array for name, array in saved.arrays.items() if name != "action.scale"}
    checkpoint.save(tmp_path / "cut", Checkpoint(arrays, saved.state, saved.config))
    with pytest.raises(CheckpointError, match=r"statistics action\.scale are missing; train the policy again"):
        load_policy(tmp_path / "cut")


def rows(values: Sequence[float]) -> Iterator[dict[str, float]]:
    return ({"step": 10.0 * k, "evaluate/success": value} for k, value in enumerate(values, start=1))


@pytest.mark.parametrize(
    ("values", "step", "stale"), [([0.1], 10, 0), ([0.5, 0.5], 20, 1), ([0.5, 0.2, 0.4], 10, 2), ([0.1, 0.3], 20, 0)]
)
def test_where_the_rollouts_stand(values: list[float], step: int, stale: int) -> None:
    best = BestCheckpoint.of(rows(values), "evaluate/success")
    assert best is not None
    assert (best.step, best.stale, best.value) == (step, stale, max(values))
    assert BestCheckpoint.of([{"step": 1.0}], "evaluate/success") is None


def test_fewer_crashes_and_less_time_are_better() -> None:
    told = [{"step": 10.0, "time_to_success_s": float("nan")}, {"step": 20.0, "time_to_success_s": 9.0}]
    assert BestCheckpoint.of(told, "time_to_success_s") == BestCheckpoint(9.0, 20, 0, 2)
    told = [{"step": 10.0, "evaluate/crashes": 1.0}, {"step": 20.0, "evaluate/crashes": 7.0}]
    assert BestCheckpoint.of(told, "evaluate/crashes") == BestCheckpoint(1.0, 10, 1, 2)


def test_the_learning_rate_warms_up_peaks_and_ends_at_its_floor() -> None:
    factors = np.array([cosine(step / 1000, step, warmup_steps=100, floor=0.1) for step in range(1001)])
    assert (np.diff(factors[:90]) > 0).all()
    assert (np.diff(factors[110:]) < 0).all()
    assert factors[0] == 0.01
    assert factors.max() > 0.97
    np.testing.assert_allclose(factors[-1], 0.1)


def test_averaged_weights_are_the_documented_recursion() -> None:
    network = MLP(anchor=None, hidden=(8,), chunk=2).build(3, 2)
    learner = Learner(network, weight_decay=0.0, ema=0.9, clip_norm=1.0)
    expected = [weight.detach().clone() for weight in network.parameters()]
    for step in range(30):
        learner.descend(network(torch.ones(4, 1, 3)).square().mean(), lr=0.1, logged={})
        decay = min(0.9, (1 + step) / (10 + step))
        expected = [decay * e + (1 - decay) * w.detach() for e, w in zip(expected, network.parameters(), strict=True)]
    for average, wanted in zip(learner.averaged.parameters(), expected, strict=True):
        torch.testing.assert_close(average, wanted)


def test_only_matrices_decay() -> None:
    optimizer = adamw(nn.Sequential(nn.Linear(3, 3), nn.LayerNorm(3)), weight_decay=0.1)
    decays = {len(group["params"]): group["weight_decay"] for group in optimizer.param_groups}
    assert decays == {1: 0.1, 3: 0.0}


def test_a_restored_optimiser_goes_on_bit_for_bit() -> None:
    def advance(network: nn.Module, optimizer: torch.optim.Optimizer, steps: range) -> None:
        for step in steps:
            optimizer.zero_grad()
            (network(torch.full((4, 3), float(step))) ** 2).sum().backward()
            optimizer.step()

    torch.manual_seed(0)
    network = nn.Linear(3, 3)
    optimizer = adamw(network, weight_decay=0.01)
    advance(network, optimizer, range(5))
    copy = nn.Linear(3, 3)
    copy.load_state_dict(network.state_dict())
    resumed = adamw(copy, weight_decay=0.01)
    from_arrays(resumed, to_arrays(optimizer))
    advance(network, optimizer, range(5, 9))
    advance(copy, resumed, range(5, 9))
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), copy.parameters(), strict=True))
