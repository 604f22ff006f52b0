"""Settings that moved or were renamed: an old key is answered with the new one, for a while."""

from collections.abc import Container, Mapping

#: Old names -> new ones, of which an algorithm or a policy has one at most.
MOVED: Mapping[str, tuple[str, ...]] = {
    "blind_to": ("masked_fields",),
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
