"""What is learned on both sides: task, steps, worlds and settings, and what either side is asked to reach.

Settings are those that the authors of Stable-Baselines3 publish for it (RL Baselines3 Zoo, ``hyperparams/ppo.yml``,
``sac.yml``, ``ddpg.yml``, ``dqn.yml``), and ours the same where ours has such a setting; on our own task, for which
they publish none, both have those written here. What differs is told by ``DIFFERENCES``, for the page. On CartPole our
``dqn`` has settings of its own because with the published ones either side ends at 500 now and then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium

import aerial_il
from aerial_il.algorithms.ddpg import DDPG
from aerial_il.algorithms.dqn import DQN
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.ppo import PPO
from aerial_il.algorithms.sac import SAC
from aerial_il.core.composition import build
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from aerial_il.suite.faces.gymnasium_ids import gymnasium_id
from experiments.common.notes import About, Note
from experiments.common.outside import Task, gymnasium_task
from experiments.sb3.theirs import Theirs

CLASSIC: dict[str, Any] = {"log_every": 1_000, "checkpoint_every": 0}
CART_POLE = (0.0, 500.0)  # returns: 1 for each step of an episode
DIFFERENCES: Note = (
    About(
        ("dqn_cartpole", "dqn_mountain_car", "ddpg_mountain_car", "ppo_cartpole", "ppo_reach", "ppo_half_cheetah"),
        "What differs by design, ours first.",
    ),
    About(
        ("ppo_reach", "ppo_half_cheetah"),
        "`ppo` commands a squashed Gaussian, theirs a Gaussian clipped to the bounds.",
    ),
    About(
        ("ppo_cartpole", "ppo_reach", "ppo_half_cheetah"),
        "The critic of `ppo` has an optimiser and a gradient limit of its own, theirs shares the actor's.",
    ),
    About(
        ("ppo_cartpole",),
        "On CartPole `ppo` standardises what it sees and divides its rewards by the deviation of returns, theirs does "
        "neither; its clip range is constant, theirs falls linearly to zero, as published.",
    ),
    About(
        ("ppo_half_cheetah",),
        "On HalfCheetah the learning rate of `ppo` falls linearly to zero, theirs is constant, as published; its "
        "critic has tanh layers, theirs ReLU.",
    ),
    About(
        ("dqn_cartpole", "dqn_mountain_car"),
        "`dqn` is a double one, whose learning rate falls to zero, theirs neither; its target networks are "
        "updated every so many updates, theirs every so many steps.",
    ),
    About(
        ("dqn_cartpole",),
        "On CartPole `dqn` has another learning rate, other targets and another loss, chosen on other seeds.",
    ),
    About(
        ("dqn_mountain_car",),
        "On MountainCar `dqn` holds a random action for up to 30 steps; that, and the falling learning rate, were "
        "chosen on other seeds.",
    ),
    About(
        ("ddpg_mountain_car",),
        "`ddpg` has the Ornstein-Uhlenbeck noise of theirs (theta 0.15, sigma 0.5, time step 0.01 s), which keeps "
        "0.9985 from step to step, but at its final deviation of 0.913 from the first step on and through all "
        "episodes; theirs begins each at zero.",
    ),
)


@dataclass(frozen=True)
class Cell:
    """One comparison.

    Attributes:
        task: Gymnasium id, or ``ROBOT:TASK`` of the suite. ours, policy: our side. theirs: the other.
        worlds: flown at once. wanted: mean return of ours to be reached, where there is a number for it.
        as_theirs: whether ours is to be no worse; so it is where it is to be sooner.
        sooner: times sooner that ours is to reach the same return. bounds: of any return, where they are known.
    """

    task: str
    ours: Algorithm
    policy: PolicySettings
    theirs: Theirs
    worlds: int = 1
    wanted: float | None = None
    as_theirs: bool = False
    sooner: float | None = None
    bounds: tuple[float, float] = (-math.inf, math.inf)

    @property
    def is_ours(self) -> bool:
        """Whether it is a cell of the suite."""
        return ":" in self.task

    def learned(self) -> Task:
        """Return where our side learns."""
        if not self.is_ours:
            return gymnasium_task(self.task)
        robot, _, task = self.task.partition(":")
        return Task(
            self.task,
            lambda count: aerial_il.load_batch(robot, task, num_envs=count, num_threads=1),
            {"task": self.task},
        )

    def maker(self) -> Any:
        """Return what makes a single world for the other side, as processes can be handed it."""
        if not self.is_ours:
            return partial(gymnasium.make, self.task)
        robot, _, task = self.task.partition(":")
        return partial(gymnasium.make, f"aerial_il:{gymnasium_id(robot, task)}", disable_env_checker=True)


def cells() -> dict[str, Cell]:
    """Return all comparisons, those that take little time first."""
    return {
        "dqn_cartpole": Cell(
            "CartPole-v1",
            build(
                DQN,
                {
                    "steps": 50_000, "lr": 1e-3, "lr_floor": 0.0, "warmup": 1_000, "update_every": 256,
                    "replay": {"batch_size": 64, "capacity": 100_000, "updates_per_step": 0.5}, "target_every": 1,
                    "tau": 0.01, "huber": 100.0, "exploration": 0.16, "epsilon": 0.04, "cadence": CLASSIC,
                },
            ),
            Categorical(hidden=(256, 256), activation="relu"),
            Theirs(
                "DQN",
                {
                    "learning_rate": 2.3e-3, "batch_size": 64, "buffer_size": 100_000, "learning_starts": 1_000,
                    "gamma": 0.99, "target_update_interval": 10, "train_freq": 256, "gradient_steps": 128,
                    "exploration_fraction": 0.16, "exploration_final_eps": 0.04,
                },
                {"net_arch": [256, 256]},
            ),
            wanted=475.0,
            bounds=CART_POLE,
        ),
        "dqn_mountain_car": Cell(
            "MountainCar-v0",
            build(
                DQN,
                {
                    "steps": 120_000, "lr": 4e-3, "lr_floor": 0.0, "warmup": 1_000, "gamma": 0.98, "update_every": 16,
                    "replay": {"batch_size": 128, "capacity": 10_000, "updates_per_step": 0.5}, "target_every": 300,
                    "exploration": 0.2, "epsilon": 0.07, "longest_hold": 30, "reward_patience": 0, "cadence": CLASSIC,
                },
            ),
            Categorical(hidden=(256, 256), activation="relu"),
            Theirs(
                "DQN",
                {
                    "learning_rate": 4e-3, "batch_size": 128, "buffer_size": 10_000, "learning_starts": 1_000,
                    "gamma": 0.98, "target_update_interval": 600, "train_freq": 16, "gradient_steps": 8,
                    "exploration_fraction": 0.2, "exploration_final_eps": 0.07,
                },
                {"net_arch": [256, 256]},
            ),
            wanted=-110.0,
            bounds=(-200.0, 0.0),
        ),
        "ddpg_mountain_car": Cell(
            "MountainCarContinuous-v0",
            build(
                DDPG,
                {
                    "steps": 100_000, "warmup": 1_000, "noise": 0.913, "noise_correlation": 0.9985,
                    "critics": {"hidden": (256, 256)}, "reward_patience": 0, "cadence": CLASSIC,
                },
            ),
            SquashedGaussian(hidden=(256, 256)),
            Theirs("DDPG", {"learning_starts": 1_000, "batch_size": 256, "noise": 0.5}, {"net_arch": [256, 256]}),
            wanted=90.0,
            bounds=(-99.9, 100.0),
        ),
        "ppo_cartpole": Cell(
            "CartPole-v1",
            build(
                PPO,
                {
                    "steps": 100_000, "rollout": {"steps": 256, "batch_size": 256, "epochs": 20}, "gae_lambda": 0.8,
                    "gamma": 0.98, "lr": 1e-3, "cadence": CLASSIC,
                },
            ),
            Categorical(hidden=(64, 64), activation="tanh"),
            Theirs(
                "PPO",
                {
                    "n_steps": 32, "batch_size": 256, "gae_lambda": 0.8, "gamma": 0.98, "n_epochs": 20,
                    "ent_coef": 0.0, "learning_rate": "lin_0.001", "clip_range": "lin_0.2",
                },
                {"net_arch": [64, 64], "activation": "tanh"},
            ),
            worlds=8,
            wanted=500.0,
            bounds=CART_POLE,
        ),
        "ppo_reach": Cell(
            "fa_hexa_arm4:reach",
            build(
                PPO,
                {
                    "steps": 1_000_000, "rollout": {"steps": 8_192, "batch_size": 512, "epochs": 10}, "gamma": 0.98,
                    "lr": 3e-4, "cadence": {"log_every": 8_192, "checkpoint_every": 0},
                },
            ),
            SquashedGaussian(hidden=(64, 64), activation="tanh", spread="free", log_std=-0.5),
            Theirs(
                "PPO",
                {"n_steps": 512, "batch_size": 512, "gamma": 0.98, "n_epochs": 10, "learning_rate": "lin_0.0003"},
                {"net_arch": [64, 64], "activation": "tanh", "log_std_init": -0.5},
                normalised=True,
                processes=True,
            ),
            worlds=16,
            sooner=2.0,
        ),
        "sac_half_cheetah": Cell(
            "HalfCheetah-v5",
            build(
                SAC,
                {
                    "steps": 100_000, "warmup": 10_000, "alpha": 1.0, "actor_every": 1,
                    "cadence": {"log_every": 1_000, "checkpoint_every": 25_000, "keep_checkpoints": 1},
                },
            ),
            SquashedGaussian(hidden=(256, 256)),
            Theirs("SAC", {"learning_starts": 10_000}, {"net_arch": [256, 256]}),
            as_theirs=True,
        ),
        "ppo_half_cheetah": Cell(
            "HalfCheetah-v5",
            build(
                PPO,
                {
                    "steps": 1_000_000, "rollout": {"steps": 512, "batch_size": 64, "epochs": 20}, "gamma": 0.98,
                    "lr": 2.0633e-05, "entropy": 0.000401762, "clip": 0.1, "gae_lambda": 0.92, "clip_norm": 0.8,
                    "critic_hidden": (256, 256),
                    "cadence": {"log_every": 8_192, "checkpoint_every": 100_000, "keep_checkpoints": 1},
                },
            ),
            SquashedGaussian(hidden=(256, 256), activation="relu", spread="free", log_std=-2.0),
            Theirs(
                "PPO",
                {
                    "batch_size": 64, "n_steps": 512, "gamma": 0.98, "learning_rate": 2.0633e-05,
                    "ent_coef": 0.000401762, "clip_range": 0.1, "n_epochs": 20, "gae_lambda": 0.92,
                    "max_grad_norm": 0.8, "vf_coef": 0.58096,
                },
                {"log_std_init": -2, "ortho_init": False, "activation": "relu", "net_arch": [256, 256]},
                normalised=True,
            ),
            wanted=5_000.0,
        ),
    }  # fmt: skip
