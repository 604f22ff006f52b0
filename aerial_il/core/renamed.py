"""Old names of keys, metrics, classes and training state, and the new ones: data by which old words are answered.

Whoever reads what an earlier version wrote (a run's ``config.yaml``, ``metrics.jsonl`` or checkpoint), or is given an
old key on the command line, looks here. Nothing else knows the old names.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

#: Settings of algorithms, as dotted paths below ``algorithm`` (in a run's configuration: below ``settings``).
ALGORITHM_KEYS: Mapping[str, str] = {
    "updates": "utd_ratio",
    "memory": "buffer_size",
    "decay": "gae_lambda",
    "cloning": "bc_pretrain_steps",
    "nearness": "bc_weight",
    "blur": "action_noise",
    "penalty": "gradient_penalty",
    "spectral": "spectral_norm",
    "warm": "warm_start",
}

#: Settings that moved into a group: where to, of which an algorithm has one at most.
MOVED: Mapping[str, tuple[str, ...]] = {
    "buffer_size": ("replay.capacity",),
    "batch_size": ("replay.batch_size", "rollout.batch_size"),
    "utd_ratio": ("replay.updates_per_step",),
    "critics": ("critics.count",),
    "critic_hidden": ("critics.hidden",),
    "critic_norm": ("critics.layer_norm",),
    "tau": ("critics.tau",),
    "rollout": ("rollout.steps",),
    "epochs": ("rollout.epochs",),
    "noise": ("exploration.noise",),
    "execute": ("exploration.execute",),
    "correlation": ("exploration.correlation",),
    "trial": ("trial.flights",),
    "trial_every": ("trial.every",),
    "reward": ("reward.form",),
    "reward_hidden": ("reward.hidden",),
    "reward_lr": ("reward.lr",),
    "reward_updates": ("reward.updates",),
    **{name: (f"reward.{name}",) for name in ("gradient_penalty", "spectral_norm", "dropout", "action_noise")},
    **{name: (f"cadence.{name}",) for name in ("log_every", "evaluate_every", "checkpoint_every", "keep_checkpoints")},
    **{
        name: (f"demonstrations.{name}",)
        for name in ("trajectories", "subsample", "bounds", "labels", "absorbing", "control")
    },
}


def moved(name: str, known: Container[str]) -> str | None:
    """Return where a setting, perhaps one of a group, stands now among those ``known``; None where it has not moved."""
    group, dot, last = name.rpartition(".")
    return next((new for each in MOVED.get(last, ()) if (new := f"{group}{dot}{each}") in known), None)


#: Settings of algorithms that earlier versions did not write, and the values by which they ran.
ADDED: Mapping[str, object] = {
    "reward": "environment",
    "critics.count": 2,
    "smoothness.temporal": 0.0,
    "smoothness.spatial": 0.0,
    "smoothness.radius": 0.05,
    "smoothness.rate_penalty": 0.0,
    "smoothness.jerk_penalty": 0.0,
    "hindsight.goals": 0,
    "hindsight.strategy": "future",
    "hindsight.tolerance": 1.0,
    "obs_norm": False,
    "prior": None,
    "waypoints.lookahead_s": 0.0,
    "waypoints.flown_by": "hand",
    "training.waypoints.kind": "Waypoints",
    "training.waypoints.lookahead_s": 0.0,
    "training.waypoints.flown_by": "hand",
}

#: Names of numbers in ``metrics.jsonl``.
METRICS: Mapping[str, str] = {
    "reward/told_expert": "reward/acc_expert",
    "reward/told_agent": "reward/acc_agent",
    "reward/steep": "reward/gradient_penalty",
    "actor/moved": "actor/approx_kl",
    "actor/clipped": "actor/clip_fraction",
    "total/lessons": "total/labelled_episodes",
}

#: Classes that a configuration names by ``_target_``.
TARGETS: Mapping[str, str] = {
    "aerial_il.algorithms.parts.gates.CoinGate": "aerial_il.algorithms.interactive.gates.coin.CoinGate",
    "aerial_il.algorithms.parts.gates.HumanGate": "aerial_il.algorithms.interactive.gates.human.HumanGate",
    "aerial_il.algorithms.parts.gates.ThriftyGate": "aerial_il.algorithms.interactive.gates.thrifty.ThriftyGate",
    "aerial_il.algorithms.interactive.gates.CoinGate": "aerial_il.algorithms.interactive.gates.coin.CoinGate",
    "aerial_il.algorithms.interactive.gates.HumanGate": "aerial_il.algorithms.interactive.gates.human.HumanGate",
    "aerial_il.algorithms.interactive.gates.ThriftyGate": "aerial_il.algorithms.interactive.gates.thrifty.ThriftyGate",
    "aerial_il.algorithms.parts.selection.Selection": "aerial_il.algorithms.supervised.selection.Selection",
    "aerial_il.algorithms.parts.supervisors.Corrector": "aerial_il.algorithms.interactive.supervisors.Corrector",
}

#: Parts of a run in training, as its checkpoints name them.
TRAINING_STATE: Mapping[str, str] = {
    "flight": "collector",
    "session": "run",
    "memory": "replay_buffer",
    "noise": "random_actions",
    "judge": "reward_net",
    "expert": "expert_buffer",
    "paid": "reward_norm",
    "moments": "obs_norm",
}
