"""Settings of on-policy learners that practise what was demonstrated: the clone they start from, and its opening.

They start from a clone of the demonstrations, trained in the folder ``prior`` of the run, or from a policy that was
trained before. It is flown chunk by chunk: a mean over overlapping chunks is no chunk that could have been sampled.
"""

from __future__ import annotations

import logging
import math
import os
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, NamedTuple

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.decisions.chunk_actor import ChunkActor
from aerial_il.algorithms.decisions.cut_short import cut_short
from aerial_il.algorithms.decisions.hand_over import HandOver
from aerial_il.algorithms.online.demonstrations import check_same
from aerial_il.algorithms.online.problem import Problem
from aerial_il.algorithms.online.rewarded_demonstrations import check_lengths
from aerial_il.algorithms.online.run import OnlineRun, open_run
from aerial_il.algorithms.rl.on_policy import ProximalOnPolicy
from aerial_il.algorithms.rl.reinforcement import Reinforcement, Reward
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.algorithms.supervised.training_set import cut_windows, digest_of, read_demos
from aerial_il.core.checkpoint import Checkpoint, digest
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
    "(algorithm.rollout) comes first. Take more than {} steps."
)
PRIOR = "prior"  # folder of the clone below a run's
ANY_CLASS = "algorithm=residual takes a prior of any class."


class Practice(NamedTuple):
    """What practice has: the run, demonstrations, an expert where there is one, and the policy that it starts from.

    That is ``begun`` as it flies by itself, and ``prior`` as practice flies it.
    """

    run: OnlineRun
    begun: ChunkPolicy
    prior: ChunkPolicy
    demos: Sequence[Episode]
    expert: Policy | None = None


@dataclass(frozen=True, kw_only=True)
class PractisedPolicy(Reinforcement):
    """Settings of these learners; stands before :class:`OnPolicy` among the bases. :meth:`practise` is the algorithm.

    The reward is sparse unless ``reward`` says otherwise.

    Attributes:
        prior: a run or policy to start from; None for a clone of the demonstrations. cloning: how that is made.
        warmup: environment steps in which the prior flies alone, and a critic learns its value.
        patience: episodes of practice are truncated at so many times the longest demonstration.
        rollout: environment steps in a rollout, of all worlds together.
    """

    demonstrated: ClassVar[bool] = True
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (PolicySettings,)
    worlds: ClassVar[int] = 64

    log_every: int = 50_000
    reward: Reward = "sparse"
    prior: str | None = None
    cloning: BC = field(default_factory=BC)
    warmup: int = 50_000
    patience: float = 2.0
    rollout: int = 65_536

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "warmup")
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
        """Clone the demonstrations, or take the prior, and practise in ``env``; see :class:`OnlineAlgorithm`.

        Args:
            policy: what is cloned; the prior's own is trained where there is one.
            expert: who can fly here, for those that need one.

        Raises:
            InvalidValueError: also for a prior that cannot fly here or be trained, and demonstrations longer than
                episodes.
        """
        begun = load_prior(self.prior, env.spec) if self.prior else None
        demos = shown(dataset or (), begun.config if begun else policy, env)
        inputs = self.inputs(env.spec, expert, demos)
        if begun is None:
            options = {"seed": seed, "resume": resume, "progress": progress}
            begun = self.cloning.train(demos, policy, run=Path(run) / PRIOR, **options)
        prior = self.flown(begun)
        self._warn_of_too_few_steps()
        problem = Problem(
            self.name,
            seed,
            prior.config,
            cut_short(env, self.longest(demos)),
            prior.interface,
            dataset=described(demos, prior),
            scheme=self.scheme,
            inputs={PRIOR: digest(Checkpoint(prior.to_checkpoint().arrays)), **inputs},
            initial=prior.network.state_dict(),
        )
        with open_run(self, problem, run, evaluate=evaluate, resume=resume, progress=progress) as opened:
            return self.practise(Practice(opened, begun, prior, demos, expert)) if opened else load_policy(run)

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        """Refuse: practice needs something to start from, which :meth:`train` brings.

        Raises:
            InvalidValueError: always.
        """
        raise InvalidValueError(f"{self.name} goes on from a clone: call train, which makes one or loads prior.")

    @abstractmethod
    def practise(self, practice: Practice) -> ChunkPolicy:
        """Collect and learn until the run has no steps left; return the trained policy."""

    def flown(self, prior: ChunkPolicy) -> ChunkPolicy:
        """Return the prior as practice flies it."""
        return prior

    def longest(self, demos: Sequence[Episode]) -> int:
        """Return after how many steps an episode of practice is truncated."""
        return math.ceil(self.patience * max(map(len, demos)))

    def _warn_of_too_few_steps(self) -> None:
        """Say so where the last rollout, of a learning rate of zero, would be the first one after the warm-up."""
        least = (math.ceil(self.warmup / self.rollout) + 1) * self.rollout
        if self.steps <= least:
            log.warning(TOO_FEW.format(self.steps, self.warmup, self.rollout, least))

    def inputs(self, spec: EnvSpec, expert: Policy | None, demos: Sequence[Episode]) -> Mapping[str, str]:
        """Return digests of whatever else it learns from, by name; refuse what cannot be learned from."""
        return {}


@dataclass(frozen=True, kw_only=True)
class AnchoredOnPolicy(ProximalOnPolicy):
    """Settings of PPO that starts from a good policy and stays near it; ``lr`` is the actor's.

    The divergences of all numbers of a chunk add up, and there are tens: ``clip`` and ``target_kl`` are wide.

    Attributes:
        critic_lr: the critic's learning rate, which stays.
        kl: weight of a decision's KL divergence from the policy that it starts from; it falls linearly to zero.
    """

    lr: float = 5e-5
    critic_lr: float = 1e-3
    epochs: int = 5
    batch_size: int = 1024
    clip: float = 0.9
    target_kl: float = 1.0
    critic_hidden: tuple[int, ...] = (128, 128)
    kl: float = 0.001

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "critic_lr")
        require_not_negative(self, "kl")


@dataclass(frozen=True, kw_only=True)
class GatedOnPolicy(AnchoredOnPolicy):
    """The same, given up where it has become worse.

    Attributes:
        gate: standard errors by which a rollout's episodes may return less than the prior's; see
            :mod:`aerial_il.algorithms.decisions.gate`. A large number for any.
    """

    gate: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "gate")


@dataclass(frozen=True, kw_only=True)
class PractisedChunks(PractisedPolicy):
    """Settings of learners that go on with the clone's own network.

    Attributes:
        execute: steps of a chunk that are flown before the next one is sampled, no more than it has.
        noise: standard deviation of the samples at first, in actions normalised by ``action_scaling``; it is learned.
        correlation: of that noise from one step of a chunk to the next.
        trial: flights in which what was learned is compared with the prior by itself, before it is handed over; 0 for
            none. trial_every: environment steps between two such trials. See
            :mod:`aerial_il.algorithms.decisions.hand_over`.
    """

    execute: int = 10
    noise: float = 0.15
    correlation: float = 0.9
    trial: int = 128
    trial_every: int = 400_000

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "execute", "noise", "trial_every")
        require_not_negative(self, "trial")
        require_share(self, "correlation", below_one=True)

    def flown(self, prior: ChunkPolicy) -> ChunkPolicy:
        """Return the prior as a policy of single chunks.

        Raises:
            InvalidValueError: its network cannot be trained by policy gradients.
        """
        check_trainable(prior, self.prior)
        execute = min(self.execute, prior.config.chunk)
        config = replace(prior.config, execute=execute, ensemble=None)
        return ChunkPolicy(config, prior.interface, prior.network, prior.origin)

    def actor(self, practice: Practice) -> ChunkActor:
        """Return the clone, exploring."""
        config = practice.prior.config
        return ChunkActor(
            practice.run.build_actor(ChunkNetwork),
            history=config.history,
            execute=config.execute,
            explored=practice.prior.interface.varied,
            deviation=self.noise,
            correlation=self.correlation,
        )

    def hand_over(self, practice: Practice, actor: ChunkActor) -> HandOver:
        """Return what decides which weights are evaluated and saved."""
        return HandOver(practice.run, practice.begun, actor.network, flights=self.trial, every=self.trial_every)


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
