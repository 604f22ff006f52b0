"""What a run learns on: an environment and its reward, demonstrations of it, or weights to start from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from torch import Tensor

from aerial_il.algorithms.online.collector import RewardScheme, Transition
from aerial_il.algorithms.online.demonstrations import check_same, random_transitions, read_transitions
from aerial_il.algorithms.online.interface import fit_interface, plain_interface
from aerial_il.algorithms.online.rewarded_demonstrations import check_lengths, check_paid, with_rewards
from aerial_il.algorithms.run.folder import flown_in
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import PolicySettings

if TYPE_CHECKING:
    from aerial_il.algorithms.online.algorithm import Algorithm

Source = Literal["environment", "sparse"]
SHOWN = "an algorithm that starts with demonstrations (algorithm=bc_ppo dataset=PATH)"
TOO_SHORT = (
    "steps is {} and {} {}: the run would end before its policy has learned anything. Set algorithm.steps well above "
    "{}, or lower algorithm.{}."
)


class Given(NamedTuple):
    """What an algorithm is handed to learn on; see :meth:`Algorithm.train`."""

    dataset: Iterable[Episode] | None
    policy: PolicySettings
    env: BatchEnv
    seed: int
    run: Path = Path()
    expert: Policy | None = None
    resume: bool = True
    progress: bool = False


@dataclass(frozen=True, eq=False)
class Problem:
    """What a run learns on.

    Attributes:
        algorithm: its name. seed: decides all randomness. policy: what is trained. env: a batch environment.
        interface: the way into and out of its network.
        demos: transitions to imitate, or flown at random in a control run; None where the reward alone teaches.
        dataset: which demonstrations these are, for the run's configuration.
        scheme: how its steps are rewarded.
        inputs: name -> digest of whatever else it learns from, such as a prior.
        initial: weights that its network starts from; None for random ones.
        start: what else an algorithm has made ready to start from.
    """

    algorithm: str
    seed: int
    policy: PolicySettings
    env: BatchEnv
    interface: Interface
    demos: Transition | None = None
    dataset: Mapping[str, Any] | None = None
    scheme: RewardScheme = field(default_factory=RewardScheme)
    inputs: Mapping[str, str] = field(default_factory=dict)
    initial: Mapping[str, Tensor] | None = None
    start: Any = None

    def describe(self) -> dict[str, Any]:
        """Return what determines the run besides its settings and policy."""
        spec, learned = self.env.spec, {"dataset": dict(self.dataset)} if self.dataset else {}
        environment = {**flown_in(self.env), "action": spec.action.level, "num_envs": int(self.env.num_envs)}
        return {"algorithm": self.algorithm, "seed": self.seed, "environment": environment, **learned, **self.inputs}


def from_reward(settings: Algorithm, given: Given) -> Problem:
    """Return a problem of the environment and its reward alone."""
    interface = plain_interface(Layout.of(given.env.spec, given.policy), given.policy)
    return Problem(settings.name, given.seed, given.policy, given.env, interface, scheme=reward_scheme(settings))


def from_demonstrations(settings: Algorithm, given: Given, *, paid: bool = True) -> Problem:
    """Return a problem of demonstrations to imitate, or that are rewarded as the learner is, if it is ``rewarded``.

    In the control run ``random_actions`` flights at random take their place.

    Args:
        paid: whether the rewards that were recorded, or success, have to say something.

    Raises:
        InvalidValueError: there are none, or fewer than asked for; they come from another environment; they carry no
            reward that could be learned from, or are longer than episodes here.
    """
    which, episodes, env, scheme = settings.demonstrations, given.dataset or (), given.env, RewardScheme()
    if settings.rewarded:
        scheme = reward_scheme(settings)
        episodes = list(episodes)
        check_lengths(episodes, env.spec)
        if paid and which.control == "none":
            check_paid(episodes, sparse=scheme.sparse)
        episodes = [with_rewards(episode, scheme, env) for episode in episodes]
    layout, demos, record = read_transitions(
        episodes,
        given.policy,
        trajectories=which.trajectories,
        subsample=which.subsample,
        labels=which.labels,
        rewarded=settings.rewarded,
        failures=getattr(settings, "failures", False),
        smoothness=scheme.smoothness,
        seed=given.seed,
    )
    check_same(layout.spec, env.spec)
    if which.control == "random_actions":
        demos = random_transitions(env, layout, len(demos.frames), seed=given.seed, scheme=scheme)
    interface = fit_interface(layout, demos.frames, demos.actions, policy=given.policy, bounds=which.bounds)
    return Problem(settings.name, given.seed, given.policy, env, interface, demos, record, scheme)


def reward_scheme(settings: Algorithm) -> RewardScheme:
    """Return how steps are rewarded, with advice for where no reward comes."""
    sparse, hindsight = getattr(settings, "reward", "environment") == "sparse", getattr(settings, "hindsight", None)
    ways = ["more demonstrations, or a better prior" if settings.demonstrated else SHOWN]
    ways += ["a dense reward (algorithm.reward=environment)"] if sparse else []
    if hindsight is not None and not hindsight.goals:
        also = " algorithm.reward=environment" if sparse else ""
        ways += [f"hindsight, where the task exposes a goal (algorithm.hindsight.goals=4{also})"]
    advice = f"Ways out: {'; '.join(ways)}."
    said = {"smoothness": "smoothness", "patience": "reward_patience"}  # of an algorithm that has them
    stated = {name: getattr(settings, key) for name, key in said.items() if hasattr(settings, key)}
    return RewardScheme(sparse=sparse, advice=advice, **stated)


def forfeits_by_success(settings: object) -> bool:
    """Whether an episode that success ends forfeits the environment's reward for the steps it might have had.

    It does not where the reward is sparse or learned, and where critics bootstrap through success: with hindsight, or
    by an absorbing state.
    """
    hindsight, shown = getattr(settings, "hindsight", None), getattr(settings, "demonstrations", None)
    goes_on = getattr(hindsight, "goals", 0) > 0 or getattr(shown, "absorbing", False)
    return getattr(settings, "reward", None) == "environment" and not goes_on


def check_steps(settings: Algorithm, name: str, flown: int) -> None:
    """Raise :class:`InvalidValueError` where a run ends with the steps ``flown`` that the setting ``name`` asks for."""
    if settings.steps <= flown:
        raise InvalidValueError(TOO_SHORT.format(settings.steps, name, attrgetter(name)(settings), flown, name))


def whole_turns(steps: int, worlds: int) -> int:
    """Return the environment steps, ``steps`` or a few more, after which all ``worlds`` have taken equally many."""
    return -(-steps // worlds) * worlds
