"""The one base of algorithms that learn while they fly: what their settings mean, and how a run is opened."""

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from aerial_il.algorithms.online.interface import check_policy
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.run import OnlineRun, open_run
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.core.checks import (
    require_choice,
    require_not_negative,
    require_positive,
    require_share,
    require_widths,
)
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian

POSITIVE = {
    "steps", "lr", "critic_lr", "actor_every", "alpha", "clip", "clip_norm", "step_size", "cg_iterations",
    "weight_limit", "threads",
}  # fmt: skip
NOT_NEGATIVE = {
    "warmup", "offline_steps", "bc_pretrain_steps", "bc_weight", "target_kl", "kl", "gate", "cg_damping", "noise",
    "target_noise", "noise_clip", "reward_patience",
}  # fmt: skip


class Algorithm(ABC):
    """What a workflow asks of an algorithm. Each states its settings itself; here is what names mean in all of them.

    What is impossible of them is refused here. A group of settings that depends on others has ``check_in(algorithm)``,
    which is called when all are known.

    Attributes:
        steps: environment steps, of all worlds together.
        warmup: the first of those steps, flown at random, or by the prior, before the actor improves.
        offline_steps: gradient steps on the dataset before the first flight.
        gamma: discount.
        lr: learning rate of all that is learned, at the start; it changes linearly.
        lr_floor: what is left of it at the end, as a share. Below 1 the final policy swings less.
        critic_lr: the critic's learning rate, which stays.
        actor_every: how many of the critics' gradient steps for each one of the actor.
        alpha: temperature at the start: weight of the entropy beside the reward.
        entropy: target entropy for each action element.
        gae_lambda: lambda of generalised advantage estimation.
        clip: how far from 1 the ratio of probabilities counts.
        clip_norm: largest norm of a gradient.
        target_kl: a pass of a mean KL divergence above 1.5 times this is the actor's last; 0 for no limit.
        kl: weight of a decision's KL divergence from the clone; it falls linearly to zero.
        gate: standard errors by which a rollout's episodes may return less than the clone's; a large number for any.
        step_size: twice the KL divergence of a step of the actor, to second order.
        cg_iterations: of conjugate gradients.
        cg_damping: added to the Fisher information's diagonal.
        critic_hidden: widths of the critic.
        noise: standard deviation of what is added to the actor's actions, which lie in [-1, 1], to explore.
        noise_correlation: of that from one step to the next; 0 for independent noise.
        target_noise: standard deviation of the noise on the target's actions.
        noise_clip: how far these are moved at most.
        subset: how many target critics Z the backup takes the minimum of.
        weight_limit: what no weight exceeds.
        bc_pretrain_steps: minibatches of behavioural cloning before the first flight.
        bc_weight: weight of the actor's squared distance from demonstrated actions beside the critics' values.
        demos_share: share of the demonstrations in each minibatch once it flies.
        reward: the ``environment``'s own, dense in the suite; or ``sparse``, 1 for success. With hindsight it is the
            environment's own rule for goals.
        reward_patience: environment steps after which a run stops whose rewards carry no information; 0 for never.
        failures: learn from failed demonstrations too; rewards tell them from the others.
        prior: a run or policy of the same class and sizes, from whose weights the actor starts; null for random ones.
            It flies through the warm-up in place of random actions, while the critics alone learn its value.
        obs_norm: standardise observations by their moments in the warm-up, which are fixed from then on.
        threads: torch threads; results repeat bit for bit at a fixed number only.

    Class attributes: ``name`` (that of its module); ``needs``, what ``train`` is handed by name; ``rewarded``, whether
    it learns from the environment's reward; ``demonstrated``, whether from demonstrations, without which it cannot do;
    ``worlds``, in how many it flies by default; ``trains``, the kinds of policy.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("env",)
    rewarded: ClassVar[bool] = True
    demonstrated: ClassVar[bool] = False
    worlds: ClassVar[int] = 8
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian,)

    __dataclass_fields__: ClassVar[dict[str, Any]]  # an algorithm is a dataclass

    if TYPE_CHECKING:  # the machinery below reads what those state that call it

        def __getattr__(self, name: str) -> Any: ...

    def __post_init__(self) -> None:
        stated = {field.name for field in fields(self)}
        weights_entropy, has_buffer = stated & {"rollout"}, stated & {"replay"}
        require_positive(self, *sorted(stated & POSITIVE), *(["warmup"] if has_buffer else []))
        require_not_negative(self, *sorted(stated & NOT_NEGATIVE), *(stated & {"entropy"} if weights_entropy else ()))
        require_share(self, *(stated & {"gamma", "noise_correlation"}), below_one=True)
        require_share(self, *(stated & {"lr_floor", "gae_lambda", "demos_share"}))
        for name in stated & {"critic_hidden", "hidden"}:
            require_widths(self, name)
        if self.rewarded and "reward" in stated:
            require_choice(self, "reward", Source)
        if "subset" in stated:
            self.critics.check_subset(self.subset)
        for name in stated:
            if check := getattr(getattr(self, name), "check_in", None):
                check(self)

    def train(
        self,
        dataset: Iterable[Episode] | None,
        policy: PolicySettings,
        *,
        env: BatchEnv,
        run: str | os.PathLike[str],
        seed: int = 0,
        expert: Policy | None = None,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn by acting in ``env``.

        Args:
            dataset: episodes of that environment to learn from; not looked at by an algorithm that is not
                ``demonstrated``.
            policy: what to train, one of those that the algorithm ``trains``.
            env: a batch environment to act in; it is reset.
            run: folder for configuration, metrics, checkpoints, a learned reward and the finished policy.
            seed: decides initial weights, exploration, minibatches and which episodes are flown.
            expert: who can fly here, for those that need one.
            evaluate: ``(policy, step) -> named numbers`` to log every ``cadence.evaluate_every`` steps and at the end.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show a progress bar.

        Raises:
            InvalidValueError: nothing to learn from, or in too few steps; another kind of policy or environment; or
                ``run`` holds another.
            SimulationDivergedError, TrainingDivergedError: something is not finite; the last checkpoint is intact.
        """
        policy = check_policy(policy, self.trains)
        problem = self.problem(Given(dataset, policy, env, seed, Path(run), expert, resume, progress))
        with open_run(self, problem, run, evaluate=evaluate, resume=resume, progress=progress) as opened:
            if opened is None:
                return load_policy(run)
            self.learn(opened)
            return opened.finish()

    @property
    def evaluate_every(self) -> int:
        """Steps between two calls of ``evaluate``, as a workflow asks every algorithm."""
        return self.cadence.evaluate_every

    @abstractmethod
    def problem(self, given: Given) -> Problem:
        """Return what is learned on: the environment's reward, demonstrations, a prior.

        Raises:
            InvalidValueError: these do not fit, or the run would end before its policy learns (:func:`check_steps`).
        """

    @abstractmethod
    def learn(self, run: OnlineRun) -> None:
        """Collect and learn until the run has no steps left."""
