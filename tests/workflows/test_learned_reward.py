"""A report shows the reward that its run has learned, where there are both a reward and a dataset."""

from __future__ import annotations

from pathlib import Path

from aerial_il.algorithms.dac import DAC
from aerial_il.core.composition import build
from aerial_il.data.recording.writer import write_episode
from aerial_il.evaluation.training_run import read_run
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from aerial_il.workflows.parts import run_results
from tests.algorithms.drift import MAX_STEPS, Drift, demonstrations


def test_the_reward_is_paid_along_the_first_demonstration(tmp_path: Path) -> None:
    demos, folder = demonstrations(2), tmp_path / "run"
    small = {"steps": 64, "warmup": 32, "bc_pretrain_steps": 0, "bc_weight": 0.0}
    nets = {"replay": {"batch_size": 8}, "critics": {"hidden": [8]}, "reward": {"hidden": [8]}}
    settings = build(DAC, {**small, **nets})
    policy = SquashedGaussian(hidden=(8,))
    settings.train(demos, policy, env=Drift(4), run=folder, progress=False)
    run, recorded = read_run(folder), tmp_path / "demo.mcap"
    write_episode(demos[0], recorded)
    ((_, paid),) = run_results.rewarded(run, str(recorded)).items()
    assert {label: values.shape for label, values in paid.items()} == {
        "as flown": (MAX_STEPS,),
        "actions shuffled": (MAX_STEPS,),
    }
    assert run_results.rewarded(run, None) == {}, "no dataset is at hand"
    assert run_results.rewarded(run, str(tmp_path / "nowhere")) == {}
    (folder / "reward").rename(tmp_path / "elsewhere")
    assert run_results.rewarded(run, str(recorded)) == {}, "nothing was learned"
