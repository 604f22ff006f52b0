"""Learning that goes on from a clone: what it starts from.

It starts from a clone of the demonstrations, trained in the folder ``prior`` of the run, or from a policy that was
trained before. A learner of chunks flies it chunk by chunk: a mean over overlapping chunks is no chunk that could have
been sampled.
"""

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, NamedTuple

from aerial_il.algorithms.on_policy.chunk_actor import ChunkActor
from aerial_il.algorithms.on_policy.cut_short import cut_short
from aerial_il.algorithms.on_policy.settings import Exploration
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import check_same
from aerial_il.algorithms.online.problem import Given, Problem, reward_scheme
from aerial_il.algorithms.online.rewarded_demonstrations import check_lengths
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.folder import PRIOR
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.algorithms.supervised.training_set import cut_windows, digest_of, read_demos
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.checks import require_positive
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import ChunkNetwork, PolicySettings

log = logging.getLogger(__name__)

TOO_FEW = (
    "In algorithm.steps={} next to nothing is learned: a warm-up of {} (algorithm.warmup) in rollouts of {} "
    "(algorithm.rollout.steps) comes first. Take more than {} steps."
)
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
    """A learner that goes on from a clone, with the :class:`Start` of its run's problem.

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

    def problem(self, given: Given) -> Problem:
        """Clone the demonstrations, or take the prior, which the learner goes on from.

        Raises:
            InvalidValueError: the prior cannot fly here or be trained, or demonstrations are longer than episodes.
        """
        alone = load_prior(self.prior, given.env.spec, alone=True) if self.prior else None
        demos = shown(given.dataset or (), alone.config if alone else given.policy, given.env)
        inputs = self.inputs(given.env.spec, given.expert, demos)
        if alone is None:
            options = {"seed": given.seed, "resume": given.resume, "progress": given.progress}
            alone = self.cloning.train(demos, given.policy, run=given.run / PRIOR, **options)
        prior = self.flown(alone)
        self._warn_of_too_few_steps()
        return Problem(
            self.name,
            given.seed,
            prior.config,
            cut_short(given.env, self.longest(demos)),
            prior.interface,
            dataset=described(demos, prior),
            scheme=reward_scheme(self),
            inputs={PRIOR: digest(Checkpoint(prior.to_checkpoint().arrays)), **inputs},
            initial=prior.network.state_dict(),
            start=Start(alone, prior, demos, given.expert),
        )

    def flown(self, prior: ChunkPolicy) -> ChunkPolicy:
        """Return a prior, loaded or cloned, as the learner flies it: as a policy of single chunks.

        Raises:
            InvalidValueError: its network cannot be trained by policy gradients, or not with this smoothness.
        """
        check_trainable(prior, self.prior)
        if self.smoothness.temporal and prior.interface.layout.moving.any():
            raise InvalidValueError(
                f"algorithm.smoothness.temporal={self.smoothness.temporal:g} compares chunks counted from where "
                "the tool is when each begins. Set it to 0, or train a clone with policy.anchor=null."
            )
        config = replace(prior.config, execute=min(self.exploration.execute, prior.config.chunk), ensemble=None)
        return ChunkPolicy(config, prior.interface, prior.network, prior.origin)

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
