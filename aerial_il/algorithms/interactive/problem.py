"""The problem of an interactive run: its settings, the expert to query, and the collector of flights."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from aerial_il.algorithms.interactive.costs import FlightCosts
from aerial_il.algorithms.run.folder import flown_in
from aerial_il.algorithms.supervised.training_set import cut_windows, digest_of, read_demos
from aerial_il.core.composition import plain
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.network import PolicySettings

if TYPE_CHECKING:
    from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm


class Collected(Protocol):
    """What came of recording flights: seeds by outcome, and control steps flown."""

    demos: list[int]
    failures: list[int]
    steps: int


class Collect(Protocol):
    """Records flights; ``aerial_il.collection.collect.collect`` is one."""

    def __call__(
        self,
        env: BatchEnv,
        policy: Policy,
        seeds: Iterable[int],
        out: str | os.PathLike[str],
        *,
        policy_name: str,
        settings: Mapping[str, Any],
        longest: int | None,
        progress: bool,
    ) -> Collected: ...


@runtime_checkable
class Operator(Protocol):
    """Somebody at the controls, a person or a model of one, who watches a learner fly and takes over as they see fit.

    What they do is no function of the seed, so what they have finished is kept through any kill.
    """

    def record(
        self, env: BatchEnv, learner: Policy, out: str | os.PathLike[str], *, seeds: range, tags: Mapping[str, Any]
    ) -> None:
        """Record flights until ``out`` holds as many as there are ``seeds``; those it holds already count.

        Args:
            env: one world of the suite. learner: flies while nobody takes over. out: a dataset folder.
            seeds: from the first on, one after another. tags: plain values for the provenance.

        Raises:
            InvalidValueError: a person cannot fly ``env``.
        """
        ...

    def notify(self, rounds: Sequence[FlightCosts], message: str) -> None:
        """Hear how the rounds so far went, and what happens now."""
        ...


@dataclass(frozen=True, eq=False)
class InteractiveProblem:
    """What an interactive run learns on.

    Attributes:
        settings: of its algorithm. policy: what is trained. seed: decides all randomness.
        env: a batch environment. expert: whom it learns from; it can take over from any state. An operator records
            the flights themselves. None where nobody is asked.
        collect: records flights. progress: show progress bars.
    """

    settings: InteractiveAlgorithm
    policy: PolicySettings
    seed: int
    env: BatchEnv
    expert: Policy | Operator | None
    collect: Collect
    progress: bool

    def origin(self, demos: Sequence[Episode]) -> dict[str, Any]:
        """Return where a policy comes from, as it is kept with it."""
        data = {"demonstrations": len(demos), "frames": sum(map(len, demos))}
        return {"algorithm": self.settings.name, "seed": self.seed, "dataset": data}

    def describe(self, demos: Sequence[Episode]) -> dict[str, Any]:
        """Return plain values that determine the run."""
        layout, _ = read_demos(demos, self.policy)
        origin, spec = self.origin(demos), self.env.spec
        return {
            **origin,
            "dataset": {**origin["dataset"], "digest": digest_of(cut_windows(demos, layout, self.policy))},
            "environment": {**flown_in(self.env), "num_envs": self.env.num_envs},
            "settings": plain(self.settings),
            **self.settings.inputs(spec),
            "policy": {"name": self.policy.name, **self.policy.to_dict()},
        }


def as_shown(episode: Episode, spec: EnvSpec) -> Episode:
    """Return the episode without fields that the environment does not show, e.g. cameras that it flies without."""
    shown = tuple(f for f in episode.spec.observation.fields if f.name in spec.observation.names)
    if len(shown) == len(episode.spec.observation.fields):
        return episode
    obs = {name: values for name, values in episode.obs.items() if name in spec.observation.names}
    return replace(episode, spec=replace(episode.spec, observation=ObservationSpec(shown)), obs=obs)
