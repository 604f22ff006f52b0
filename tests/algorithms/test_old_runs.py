"""Runs that an earlier version began are gone on with by the new names, or refused by them."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from aerial_il.algorithms.run.folder import CONFIG, METRICS, read_metrics
from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import InvalidValueError
from tests.algorithms import train_flying, train_tiny
from tests.algorithms.test_resume import assert_same_end

# What the released version wrote; spelled out here, so that a change of the table that answers it is noticed.
OLD_SETTINGS = {
    "bc_pretrain_steps": "cloning",
    "bc_weight": "nearness",
    "replay.capacity": "memory",
    "replay.updates_per_step": "updates",
    "replay.batch_size": "batch_size",
    "critics.hidden": "critic_hidden",
    "critics.layer_norm": "critic_norm",
    "critics.tau": "tau",
    "reward.form": "reward",
    "reward.hidden": "reward_hidden",
    "reward.lr": "reward_lr",
    "reward.updates": "reward_updates",
    "reward.action_noise": "blur",
    "reward.gradient_penalty": "penalty",
    "reward.spectral_norm": "spectral",
    "reward.dropout": "dropout",
    **{f"demonstrations.{name}": name for name in ("trajectories", "subsample", "bounds", "labels")},
    **{f"demonstrations.{name}": name for name in ("absorbing", "control")},
    **{f"cadence.{name}": name for name in ("log_every", "evaluate_every", "checkpoint_every", "keep_checkpoints")},
}
NOT_YET = {"critics.count"}  # settings that it did not have
OLD_PARTS = {
    "collector": "flight",
    "run": "session",
    "replay_buffer": "memory",
    "random_actions": "noise",
    "reward_net": "judge",
    "expert_buffer": "expert",
}


def begun(train: Any, run: Path, at: int, evaluate: Any) -> Path:
    """Train until step ``at``, and return the newest checkpoint."""

    def stop(policy: Any, step: int) -> Mapping[str, float]:
        if step >= at:
            raise KeyboardInterrupt
        return evaluate(policy, step)

    with pytest.raises(KeyboardInterrupt):
        train(run, evaluate=stop)
    return max((run / checkpoint.FOLDER).iterdir())


def rewrite(folder: Path, old: Any) -> None:
    """Leave one checkpoint in the folder's run, as ``old`` makes it of the present one."""
    saved = checkpoint.load(folder)
    for other in folder.parent.iterdir():
        shutil.rmtree(other)
    checkpoint.save(folder, old(saved))


def test_a_run_of_dac_with_old_names_ends_with_the_same_bytes(tmp_path: Path) -> None:
    whole, run = tmp_path / "whole", tmp_path / "run"
    train_flying.train("dac", str(whole))
    newest = begun(lambda run, **o: train_flying.train("dac", str(run), **o), run, 300, train_flying.evaluate)

    def old(saved: Checkpoint) -> Checkpoint:
        arrays = {_old_array(name): array for name, array in saved.arrays.items()}
        parts = {OLD_PARTS.get(name, name): values for name, values in saved.state["parts"].items()}
        return Checkpoint(arrays, {**saved.state, "parts": parts}, saved.config)

    rewrite(newest, old)
    config = yaml.safe_load((run / CONFIG).read_text())
    settings = {key: value for key, value in flat(config["settings"]).items() if key not in NOT_YET}
    assert OLD_SETTINGS.keys() <= settings.keys()
    config["settings"] = {OLD_SETTINGS.get(key, key): value for key, value in settings.items()}
    assert not [key for key in config["settings"] if "." in key], "groups came later"
    (run / CONFIG).write_text(yaml.safe_dump(config, sort_keys=False))
    config["settings"]["nearness"] = 2.0
    other = tmp_path / "other"
    shutil.copytree(run, other)
    (other / CONFIG).write_text(yaml.safe_dump(config))
    with pytest.raises(InvalidValueError, match=r"settings\.bc_weight: 2\.0 -> 1\.0"):
        train_flying.train("dac", str(other))
    train_flying.train("dac", str(run))
    assert_same_end(run, whole)


def flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings by dotted keys."""
    parts = [flat(v, f"{prefix}{k}.") if isinstance(v, Mapping) else {f"{prefix}{k}": v} for k, v in tree.items()]
    return {key: value for part in parts for key, value in part.items()}


def _old_array(name: str) -> str:
    head, _, rest = name.partition(".")
    part, _, inner = rest.partition(".")
    return f"parts.{OLD_PARTS.get(part, part)}.{inner}" if head == "parts" else name


def test_a_run_of_bc_with_the_old_state_ends_with_the_same_bytes(tmp_path: Path) -> None:
    whole, run = tmp_path / "whole", tmp_path / "run"
    train_tiny.train(str(whole))
    newest = begun(lambda run, **o: train_tiny.train(str(run), **o), run, 80, train_tiny.evaluate)

    def old(saved: Checkpoint) -> Checkpoint:
        values, arrays = saved.state["parts"]["learner"], dict(saved.arrays)
        generator = arrays.pop("torch.generator")
        kept = {k: v for k, v in arrays.items() if not k.startswith("parts.")}
        network = {k.removeprefix("parts."): v for k, v in arrays.items() if k.startswith("parts.learner.")}
        network = {k: v for k, v in network.items() if not k.startswith("learner.averaged.")}
        sums = values["means"]["sums"]
        learner = {"step": values["step"], "elapsed_s": values["elapsed_s"]}
        learner |= {"sums": {k: total for k, (total, _) in sums.items()}}
        learner |= {"summed": int(max((count for _, count in sums.values()), default=0))}
        learner["rng"] = {"cpu": np.asarray(generator).tobytes().hex()}
        state = {k: v for k, v in saved.state.items() if k != "parts"}
        return Checkpoint({**kept, **network}, {**state, "learner": learner}, saved.config)

    rewrite(newest, old)
    train_tiny.train(str(run))
    assert_same_end(run, whole)


def test_old_metrics_are_read_by_their_new_names(tmp_path: Path) -> None:
    (tmp_path / METRICS).write_text('{"step": 10, "reward/told_expert": 0.5, "actor/moved": 0.1, "other": 1.0}\n')
    assert read_metrics(tmp_path) == [{"step": 10, "reward/acc_expert": 0.5, "actor/approx_kl": 0.1, "other": 1.0}]
