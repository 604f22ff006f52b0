"""The one base of algorithms that learn in rounds of flights: it opens a run, and states no settings of its own."""

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.problem import Collect, InteractiveProblem, Operator
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import digest
from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.waypoints import Waypoints
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings


class InteractiveAlgorithm(ABC):
    """What the settings mean that all such algorithms have; each states their values; :meth:`learn` is the algorithm.

    Attributes:
        rounds: of flying and learning, after a first training on the demonstrations.
        episodes: labelled flights per round.
        training: behaviour cloning of the dataset so far, used as it is in the first and in the last round.
        between_steps: optimisation steps of the rounds between.
        patience: a labelled flight that has not ended is cut off when it has lasted this many times as long as the
            longest demonstration: a learner that hangs would fill the dataset with one state; 0 for the task's limit.
        demos_share: of each minibatch, at least, that comes from the demonstrations, however much is flown after them.
            What a learner brings about is mostly where it hangs. Half and half is what intervention weighted regression
            gives the two kinds of steps (A. Mandlekar et al., "Human-in-the-loop imitation learning using remote
            teleoperation", 2020); 0 visits all steps alike, as the paper of DAgger does.
        warm_start: all rounds but the first go on from the weights of the round before; otherwise each starts afresh.
        evaluate_every: rounds between two evaluations; the last one is always evaluated; 0 for that one only.
        keep_checkpoints: how many of the newest rounds' policies stay on disk.

    Class attributes: ``name`` (that of its module); ``needs``, what ``train`` is handed by name; ``rewarded`` and
    ``demonstrated``: it learns from demonstrations, never from the environment's reward.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("env", "expert", "collect")
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    if TYPE_CHECKING:  # each states its settings itself
        training: BC

        def __getattr__(self, name: str) -> Any: ...

    def __post_init__(self) -> None:
        require_positive(self, "rounds", "episodes", "between_steps", "keep_checkpoints")
        require_not_negative(self, "evaluate_every", "patience")
        require_share(self, "demos_share", below_one=True)
        if self.training.evaluate_every:
            raise InvalidValueError(
                f"training.cadence.evaluate_every is {self.training.evaluate_every}; rounds are judged when they end, "
                "every so many of them: set evaluate_every."
            )

    @property
    def worlds(self) -> int:
        """How many worlds it flies in at once, if nobody says otherwise."""
        return self.episodes

    @property
    def seeds_per_round(self) -> int:
        """How many flights of any kind a round makes."""
        return self.episodes

    @property
    def between(self) -> BC:
        """Behaviour cloning in the rounds between the first and the last."""
        return replace(self.training, steps=self.between_steps)

    @property
    def waypoints(self) -> Waypoints:
        """How flights by hand are relabelled."""
        return self.training.waypoints

    def relabelling(self, waypoints: Waypoints) -> Self:
        """Return the same settings for flights by hand that are relabelled so."""
        return replace(self, training=self.training.relabelling(waypoints))  # type: ignore[type-var]

    def learns_from(self, flight: Episode) -> bool:
        """Whether a flight of a round joins the dataset; here one with labels."""
        return bool(flight.asked.any())

    def inputs(self, spec: EnvSpec) -> Mapping[str, Any]:
        """Return what decides a run in ``spec`` besides settings, policy and demonstrations, all of it checked."""
        prior: str | None = getattr(self, "prior", None)
        return {} if prior is None else {"prior": digest(load_prior(prior, spec).to_checkpoint())}

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicySettings,
        *,
        run: str | os.PathLike[str],
        env: BatchEnv,
        collect: Collect,
        expert: Policy | Operator | None = None,
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn by flying.

        Args:
            dataset: demonstrations to start with, flown in the same kind of environment; failures are left out.
            policy: what to train.
            run: folder of the run; see :mod:`aerial_il.algorithms.interactive.rounds`.
            env: batch environment to fly in. expert: whom to ask, or who sits at the controls. collect: records
                flights.
            seed: decides weights, minibatches, coins and the seeds of the flights.
            evaluate: ``(policy, round) -> named numbers`` from flights on seeds of its own.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show progress bars.

        Returns:
            The policy of the last round, as saved in ``run/policy``.

        Raises:
            InvalidValueError: demonstrations of another environment, no expert, or ``run`` holds another run.
            SimulationDivergedError, StorageError: from the flights. The errors of supervised learning.
        """
        problem = InteractiveProblem(self, policy, seed, env, expert, collect, progress)
        with Rounds.open(run, dataset, problem, resume=resume) as rounds:
            if rounds.finished is None:
                self.learn(rounds, evaluate)
                return rounds.finish()
            return rounds.finished

    @abstractmethod
    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> None:
        """Fly and learn until no round is left."""
