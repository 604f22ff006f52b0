"""Reinforcement learning with prior data (RLPD): a soft actor-critic on demonstrations and its own flights alike.

Nothing is cloned and nothing is learned beforehand. One half of each minibatch are demonstrations, rewarded as the
agent is, and one half is what the agent flew (symmetric sampling). What makes that stable is in the critics: an
ensemble of E with LayerNorm, which bounds the values of actions that were never tried. It allows several updates for
each step. Each critic learns

    ``Q(s, a) = r + gamma * (min over Z of Q'(s', a') - alpha log pi(a' | s'))``,    a' ~ pi(. | s'),

with Z target critics sampled anew for each update; the actor minimises ``alpha log pi(a | s) - mean over E of Q(s, a)``
at every ``actor_every``-th update, and alpha is adjusted so that the entropy stays near its target. ``bc_weight``
pulls the actor to demonstrated actions besides, which the source does not.

An episode that ends by success goes on in an absorbing state with the reward of its end (``absorbing``): a reward for
every step would otherwise teach to stop just short of success. One that ends by a crash is terminal. With ``hindsight``
there is no absorbing state: flights are stored with other goals too, and critics bootstrap through success.

``demonstrations.control=random_actions`` puts as many transitions of random flights, with their rewards, in their
place.

Metrics: ``critic/loss``, ``critic/value``, ``critic/spread`` (standard deviation over the ensemble), ``actor/loss``,
``actor/entropy``, ``actor/alpha``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring policy;
``evaluate/<name>``; ``elapsed_s``.

Source: P. Ball, L. Smith, I. Kostrikov, S. Levine, "Efficient Online Reinforcement Learning with Offline Data", 2023,
algorithm 1; there 20 updates a step, here 4.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from aerial_il.algorithms.off_policy.agent import squared_error
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.off_policy.problems import from_demonstrations
from aerial_il.algorithms.off_policy.settings import Critics, Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch, concatenated
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.sac import SoftActorCritic
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class RLPD(Algorithm):
    """Reinforcement learning with prior data (Ball et al. 2023, algorithm 1).

    Attributes:
        warmup: the first of those steps, flown at random before anything is learned.
    """

    name: ClassVar[str] = "rlpd"
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 4
    alpha: float = 0.1
    entropy: float = -0.5
    subset: int = 2
    bc_weight: float = 0.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=4.0)
    critics: Critics = Critics(count=10, hidden=(256, 256), layer_norm=True, tau=0.005)
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    failures: bool = False
    reward: Source = "environment"
    reward_patience: int = 200_000
    hindsight: Hindsight = Hindsight(goals=0, strategy="future", tolerance=1.0)
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        absorbing, half = self.demonstrations.absorbing, self.replay.batch_size // 2
        agent = EnsembleActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        demos = run.demos.buffer(run.interface, run.rng("demonstrations"), absorbing=absorbing, reward=None)
        flights = ExperienceReplay(run, self.replay.capacity, hindsight=self.hindsight, absorbing=absorbing)
        pilot = RandomActions(run.sizes[1], run.rng("warm-up"))

        def update(improve: bool) -> dict[str, float]:
            del improve  # nothing is learned in the warm-up
            near = demos.sample(half)
            batch = concatenated(near, flights.buffer.sample(self.replay.batch_size - half))
            return agent.update(batch, demos=near)

        learn_off_policy(run, self, agent, flights, update, pilot=pilot, parts={"demonstrations": demos})


class EnsembleActorCritic(SoftActorCritic):
    """The agent of ``sac`` with an ensemble of critics: backups ask some of them, the actor their mean."""

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error, summed over the critics."""
        return squared_error(self.critics.network, batch, self.bellman_targets(batch), spread=True)

    def target_values(self, obs: Tensor, actions: Tensor) -> Tensor:
        chosen = torch.randperm(self.settings.critics.count)[: self.settings.subset]
        return self.targets.network(obs, actions, chosen).min(0).values

    def actor_values(self, obs: Tensor, actions: Tensor) -> Tensor:
        return self.critics.network(obs, actions).mean(0)
