"""Learning that goes on from a clone: what it starts from, and how its run is opened.

It starts from a clone of the demonstrations, trained in the folder ``prior`` of the run, or from a policy that was
trained before. A learner of chunks flies it chunk by chunk: a mean over overlapping chunks is no chunk that could have
been sampled.
"""

from __future__ import annotations

import logging
import math
import os
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, NamedTuple

from aerial_il.algorithms.on_policy.chunk_actor import ChunkActor
from aerial_il.algorithms.on_policy.cut_short import cut_short
from aerial_il.algorithms.on_policy.settings import Exploration
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import check_same
from aerial_il.algorithms.online.problem import Given, Problem
from aerial_il.algorithms.online.rewarded_demonstrations import check_lengths
from aerial_il.algorithms.online.rewards import reward_scheme
from aerial_il.algorithms.online.run import OnlineRun, open_run
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.algorithms.supervised.training_set import cut_windows, digest_of, read_demos
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.checks import require_positive
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import ChunkNetwork, PolicySettings

log = logging.getLogger(__name__)

TOO_FEW = (
    "In algorithm.steps={} next to nothing is learned: a warm-up of {} (algorithm.warmup) in rollouts of {} "
    "(algorithm.rollout.steps) comes first. Take more than {} steps."
)
PRIOR = "prior"  # folder of the clone below a run's
ANY_CLASS = "algorithm=residual takes a prior of any class."


class Start(NamedTuple):
    """What learning starts from: a policy, the demonstrations, and an expert where there is one.

    The policy flies ``alone`` as it was saved, and as ``prior`` as the learner flies it.
    """

    alone: ChunkPolicy
    prior: ChunkPolicy
    demos: Sequence[Episode]
    expert: Policy | None = None

    def chunk_actor(self, run: OnlineRun, exploration: Exploration) -> ChunkActor:
        """Return the clone, exploring."""
        config = self.prior.config
        return ChunkActor(
            run.build_actor(ChunkNetwork),
            history=config.history,
            execute=config.execute,
            explored=self.prior.interface.varied,
            deviation=exploration.noise,
            correlation=exploration.correlation,
        )


class FromClone(Algorithm):
    """Opens the run of a learner that goes on from a clone; :meth:`go_on` is the algorithm.

    Attributes:
        warmup: environment steps in which the clone flies as it is, and a critic learns its value.
        prior: a run or policy to start from; null for a clone of the demonstrations.
        cloning: how that is made.
        patience: episodes of practice are truncated at so many times the longest demonstration.
    """

    demonstrated: ClassVar[bool] = True
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (PolicySettings,)
    worlds: ClassVar[int] = 64

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "patience")

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
        """Clone the demonstrations, or take the prior, and go on from there in ``env``; see :class:`Algorithm`.

        Args:
            policy: what is cloned; the prior's own is trained where there is one.
            expert: who can fly here, for those that need one.

        Raises:
            InvalidValueError: also for a prior that cannot fly here or be trained, and demonstrations longer than
                episodes.
        """
        alone = load_prior(self.prior, env.spec) if self.prior else None
        demos = shown(dataset or (), alone.config if alone else policy, env)
        inputs = self.inputs(env.spec, expert, demos)
        if alone is None:
            options = {"seed": seed, "resume": resume, "progress": progress}
            alone = self.cloning.train(demos, policy, run=Path(run) / PRIOR, **options)
        prior = self.flown(alone)
        self._warn_of_too_few_steps()
        problem = Problem(
            self.name,
            seed,
            prior.config,
            cut_short(env, self.longest(demos)),
            prior.interface,
            dataset=described(demos, prior),
            scheme=reward_scheme(self),
            inputs={PRIOR: digest(Checkpoint(prior.to_checkpoint().arrays)), **inputs},
            initial=prior.network.state_dict(),
        )
        with open_run(self, problem, run, evaluate=evaluate, resume=resume, progress=progress) as opened:
            return self.go_on(opened, Start(alone, prior, demos, expert)) if opened else load_policy(run)

    @abstractmethod
    def flown(self, prior: ChunkPolicy) -> ChunkPolicy:
        """Return the prior as the learner flies it.

        Raises:
            InvalidValueError: it cannot be learned from.
        """

    @abstractmethod
    def go_on(self, run: OnlineRun, start: Start) -> ChunkPolicy:
        """Collect and learn until the run has no steps left; return the trained policy."""

    def problem(self, given: Given) -> Problem:
        """Refuse: there has to be something to start from, which :meth:`train` brings."""
        raise InvalidValueError(f"{self.name} goes on from a clone: call train, which makes one or loads prior.")

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        """Refuse: there has to be something to start from, which :meth:`train` brings."""
        raise InvalidValueError(f"{self.name} goes on from a clone: call train, which makes one or loads prior.")

    def longest(self, demos: Sequence[Episode]) -> int:
        """Return after how many steps an episode of practice is truncated."""
        return math.ceil(self.patience * max(map(len, demos)))

    def _warn_of_too_few_steps(self) -> None:
        """Say so where the last rollout, of a learning rate of zero, would be the first one after the warm-up."""
        rollout = self.rollout.steps
        least = (math.ceil(self.warmup / rollout) + 1) * rollout
        if self.steps <= least:
            log.warning(TOO_FEW.format(self.steps, self.warmup, rollout, least))

    def inputs(self, spec: EnvSpec, expert: Policy | None, demos: Sequence[Episode]) -> Mapping[str, str]:
        """Return digests of whatever else it learns from, by name; refuse what cannot be learned from."""
        return {}


def chunked(prior: ChunkPolicy, source: str | None, exploration: Exploration) -> ChunkPolicy:
    """Return a prior, loaded from ``source`` or cloned, as a policy of single chunks.

    Raises:
        InvalidValueError: its network cannot be trained by policy gradients.
    """
    check_trainable(prior, source)
    config = replace(prior.config, execute=min(exploration.execute, prior.config.chunk), ensemble=None)
    return ChunkPolicy(config, prior.interface, prior.network, prior.origin)


def shown(dataset: Iterable[Episode], policy: PolicySettings, env: BatchEnv) -> list[Episode]:
    """Return the demonstrations.

    Raises:
        InvalidValueError: there are none, they come from another environment, or they are longer than episodes here.
    """
    layout, demos = read_demos(dataset, policy)
    check_same(layout.spec, env.spec)
    check_lengths(demos, env.spec)
    return demos


def described(demos: Sequence[Episode], prior: ChunkPolicy) -> dict[str, object]:
    """Return which demonstrations these are, for the run's configuration."""
    windows = cut_windows(demos, prior.interface.layout, prior.config)
    return {"demonstrations": len(demos), "frames": len(windows), "digest": digest_of(windows)}


def check_trainable(prior: ChunkPolicy, source: str | None) -> None:
    """Raise :class:`InvalidValueError` unless policy gradients can train the prior's network."""
    name = f"policy={prior.config.name}" if source is None else f"The prior {source} (policy={prior.config.name})"
    if type(prior) is not ChunkPolicy:
        raise InvalidValueError(f"{name} stands beside another one: its weights alone do not fly. {ANY_CLASS}")
    if prior.interface.layout.images:
        raise InvalidValueError(f"{name} sees images; practice on state fields alone can train it. {ANY_CLASS}")
    if prior.network.noise_size:
        raise InvalidValueError(
            f"{name} draws its chunks from noise of its own, so that how likely one was is not known. Clone with "
            f"policy=mlp, recurrent, gaussian or squashed_gaussian; {ANY_CLASS}"
        )
    if prior.config.name == "categorical":
        raise InvalidValueError(f"{name} chooses among a few actions and has no chunk to shift: take algorithm=ppo.")
