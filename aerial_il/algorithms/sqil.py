"""Soft Q imitation learning: the demonstrator's transitions have reward 1, the agent's 0; no reward is learned.

A soft actor-critic (:mod:`aerial_il.algorithms.sac`, whose losses these are) on minibatches of which one half are
demonstrations. To be rewarded, the agent must go where demonstrations go and return there when it has strayed. Nothing
adversarial, hence hard to break and quick; yet the rewards never change, so an agent that imitates well still receives
0, and long training can drift away again.

``control`` runs the same without a demonstration, see :mod:`aerial_il.algorithms.dac`; ``constant_reward`` rewards
every step before an end with 1.

Metrics: those of ``sac``; ``episode/return`` is the environment's own, which the agent never sees.

Source: S. Reddy, A. Dragan, S. Levine, "SQIL: Imitation Learning via Reinforcement Learning with Sparse Rewards", 2020.
"""

from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.off_policy.problems import check_warmup
from aerial_il.algorithms.off_policy.settings import Critics, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem, from_demonstrations
from aerial_il.algorithms.online.replay_buffer import alive, concatenated
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.sac import SoftActorCritic
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class SQIL(Algorithm):
    """Soft Q imitation learning (Reddy et al. 2020)."""

    name: ClassVar[str] = "sqil"
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 2
    alpha: float = 0.1
    entropy: float = -1.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=2, hidden=(256, 256), layer_norm=False, tau=0.005)
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        check_warmup(self, given.env)
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        absorbing, half = self.demonstrations.absorbing, self.replay.batch_size // 2
        agent = SoftActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        demos = run.demos.buffer(run.interface, run.rng("expert"), absorbing=absorbing, reward=1.0)
        flights = ExperienceReplay(run, self.replay.capacity, absorbing=absorbing, rewarded=False)
        pilot = RandomActions(run.sizes[1], run.rng("warm-up"))

        def update(improve: bool) -> dict[str, float]:
            del improve  # nothing is learned in the warm-up
            if self.demonstrations.control == "constant_reward":
                return agent.update(alive(flights.buffer.sample(self.replay.batch_size)))
            near = demos.sample(half)
            return agent.update(concatenated(near, flights.buffer.sample(self.replay.batch_size - half)))

        learn_off_policy(run, self, agent, flights, update, pilot=pilot, parts={"expert_buffer": demos})
