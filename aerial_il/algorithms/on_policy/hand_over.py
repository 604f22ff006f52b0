"""What practice hands over: the newest weights that flew no worse than the prior by itself; until then, the prior.

Learners of chunks fly otherwise than most priors, which plan anew in every step and average overlapping chunks: with
the very same weights a policy of single chunks can be the poorer one, until it has learned enough. Now and then both
therefore fly the same start states as they would be used, without noise. These trials decide what is evaluated on the
way, saved and returned; what is learned does not depend on them.
"""

import copy
import logging
import math

import numpy as np

from aerial_il.algorithms.on_policy.cut_short import uncut
from aerial_il.algorithms.on_policy.settings import Trial
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Part
from aerial_il.core.contracts import BatchEnv, begin_episodes
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import ChunkNetwork

log = logging.getLogger(__name__)

STILL_THE_PRIOR = (
    "Nothing that was learned flew as well as the prior does by itself: the policy of this run is the prior. Train for "
    "longer (algorithm.steps), or explore less (algorithm.exploration.noise)."
)
ERRORS = 1.0  # standard errors of the mean difference by which a learner may return less
FIRST_SEED, SEEDS = 500_000, 500_000  # between those of evaluations, from 10,000, and of practice, from 1,000,000


class HandOver(Part):
    """Lets the prior and what was learned from it fly the same start states, and keeps the weights that passed.

    Args:
        run: whose policies it decides, from now on. prior: as it flies by itself. network: what learns.
        trial: how many flights, with 0 whatever was learned passes; and how often, the last one where training ends.
    """

    changing = ("_wanted", "_handed", "_passed", "_turn")

    def __init__(self, run: OnlineRun, prior: ChunkPolicy, network: ChunkNetwork, trial: Trial) -> None:
        self._run, self._prior, self._network, self._every = run, prior.fresh(), network, trial.every
        self._handed, self._passed = copy.deepcopy(network), False
        self._wanted, self._turn = np.zeros(0), 0
        worlds = run.collector.n
        batches = math.ceil(trial.flights / worlds)
        drawn = run.rng("trial").choice(SEEDS, batches * worlds, replace=False)
        self._seeds = FIRST_SEED + drawn.reshape(batches, worlds)
        run.wrap = self._policy

    def after_learning(self) -> dict[str, float]:
        """Hold a trial of what has been learned, where one is due; return its metrics: both sides' mean returns."""
        collector = self._run.collector
        if not len(self._seeds):
            self._pass()
        if not len(self._seeds) or (collector.steps // self._every == self._turn and self._run.left):
            return {}
        if not len(self._wanted):
            self._wanted = flown_returns(collector, self._prior, self._seeds)
        returns = flown_returns(collector, self._run.policy_of(self._network), self._seeds)
        self._turn = collector.steps // self._every
        more = returns - self._wanted
        if more.mean() >= -ERRORS * more.std() / math.sqrt(len(more)):
            self._pass()
        return {"trial/return": float(returns.mean()), "trial/prior": float(self._wanted.mean())}

    def close(self) -> None:
        """Say so where what may be used is still the prior when training ends."""
        if not self._passed:
            log.warning(STILL_THE_PRIOR)

    def _pass(self) -> None:
        self._passed = True
        self._handed.load_state_dict(self._network.state_dict())

    def _policy(self, own: ChunkPolicy) -> ChunkPolicy:
        """Return what may be used in place of the learner's ``own`` policy."""
        config, network = (own.config, self._handed) if self._passed else (self._prior.config, self._prior.network)
        return ChunkPolicy(config, own.interface, network, own.origin)


def flown_returns(collector: Collector, policy: ChunkPolicy, seeds: np.ndarray) -> np.ndarray:
    """Return the undiscounted returns (B * n,) of a policy's flights in a collector's worlds, never cut short.

    What these show is as it was afterwards; the steps flown count among the collector's.

    Args:
        seeds: (B, n) of the episodes.
    """
    with collector.lent() as env:
        flights = [_flown(uncut(env), policy, batch, sparse=collector.scheme.sparse) for batch in seeds]
    collector.steps += sum(steps for _, steps in flights)
    return np.concatenate([returns for returns, _ in flights])


def _flown(env: BatchEnv, policy: ChunkPolicy, seeds: np.ndarray, *, sparse: bool) -> tuple[np.ndarray, int]:
    """Return the returns (n,) of one flight in each world, and how many steps they took."""
    obs, flying = env.reset(seeds), np.ones(len(seeds), bool)
    returns, steps = np.zeros(len(seeds)), 0
    policy.attach(env)
    begin_episodes(policy, seeds)
    while flying.any():
        result, steps = env.step(policy.act(obs), flying), steps + int(flying.sum())
        success = np.asarray(result.info.get("success", np.zeros(len(seeds))), bool)
        returns += np.where(flying, success if sparse else result.reward, 0.0)
        flying = flying & ~(result.terminated | result.truncated | (success & env.ends_at_success))
        obs = result.obs
    return returns, steps
