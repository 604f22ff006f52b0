"""The one on-policy loop: fly a rollout, judge what was done in it, learn from it, and forget it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from aerial_il.algorithms.on_policy.actor_critic import ActorCritic
from aerial_il.algorithms.on_policy.advantages import Advantages, Judged, RewardNorm, gae
from aerial_il.algorithms.on_policy.decisions import Decisions, Pilot
from aerial_il.algorithms.on_policy.gate import ReturnGate
from aerial_il.algorithms.on_policy.hand_over import HandOver
from aerial_il.algorithms.on_policy.steps import StepPilot
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import check_steps, whole_turns
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Stateful
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.network import ChunkNetwork, StochasticNetwork


def learn_on_policy(
    run: OnlineRun,
    settings: Algorithm,
    pilot: Pilot,
    agent: ActorCritic,
    actor: ChunkNetwork,
    *,
    warmup: int = 0,
    rewarded: Callable[[Decisions], tuple[np.ndarray, np.ndarray | float]] | None = None,
    gate: ReturnGate | None = None,
    hand_over: HandOver | None = None,
    more: Callable[[Decisions], Mapping[str, float]] | None = None,
    parts: Mapping[str, Stateful] | None = None,
) -> None:
    """Fly and learn until no steps are left.

    Args:
        pilot: flies. agent: learns. actor: the network whose policy is evaluated on the way and saved.
        warmup: steps of the learner up to which it flies as it is, while the critic alone learns.
        rewarded: gives the rewards (T, n) of a rollout, and the values after terminal steps; None for those of the
            environment, divided by the running deviation of returns, with nothing after an end.
        gate: gives up what flew worse than it began. hand_over: decides what is evaluated and saved.
        more: further numbers of a rollout for the metrics. parts: what else changes, by name.
    """
    reward_norm = RewardNorm(run.collector.n, settings.gamma)

    def scaled(rollout: Decisions) -> tuple[np.ndarray, float]:
        return reward_norm.scale(rollout.rewards, rollout.ended), 0.0

    changing = {"agent": agent, "pilot": pilot, "gate": gate, "hand_over": hand_over, **(parts or {})}
    changing |= {} if rewarded else {"reward_norm": reward_norm}
    run.start(actor, {name: part for name, part in changing.items() if part is not None})
    pilot.standardise()
    while run.goes_on():
        warming_up = pilot.flown < warmup
        rollout = pilot.collect(settings.rollout.steps)
        improve = gate.passes(rollout.rewards, rollout.ended, warming_up=warming_up) if gate else not warming_up
        rewards, end_values = (rewarded or scaled)(rollout)
        run.log(more(rollout) if more else {})
        if decisions := judged(rollout, rewards, end_values, agent, settings):
            run.log({**agent.learn(decisions, left=run.left, improve=improve), "critic/value": decisions.value})
            run.log({"actor/fallbacks": float(not (improve or warming_up))} if gate else {})
        if hand_over and ((decisions and improve) or not run.left):
            run.log(hand_over.after_learning())
        pilot.standardise()
        run.end_turn()
    if hand_over:
        hand_over.close()


def learn_step_by_step(
    run: OnlineRun, settings: Algorithm, agent_of: Callable[[Any, StochasticNetwork, int], ActorCritic]
) -> None:
    """Learn from single steps and the environment's reward.

    Args:
        agent_of: ``(settings, actor, Do)`` -> what learns.
    """
    actor = run.build_actor(StochasticNetwork)
    agent = agent_of(settings, actor, run.sizes[0])
    learn_on_policy(run, settings, StepPilot(run, actor, obs_norm=True), agent, actor)


def judged(
    rollout: Decisions, rewards: np.ndarray, end_values: np.ndarray | float, agent: ActorCritic, settings: Algorithm
) -> Judged | None:
    """Return the decisions of a rollout with their generalised advantages; None if there are too few to compare.

    Args:
        rewards: (T, n) of each step. end_values: (T, n) of what follows a terminal step; elsewhere of no effect.
    """
    made, values = rollout.decided, agent.values(rollout.obs)
    if made.sum() < 2:
        return None
    after = np.where(rollout.terminal, end_values, agent.values(rollout.next_obs))
    if rollout.normalised is None:  # discounted over several steps, as precise as rewards
        after = after.astype(float)
    factors = {"gamma": settings.gamma, "gae_lambda": settings.gae_lambda}
    advantages, closing = gae(rewards, values, after, rollout.ended, made, **factors)
    steps, worlds = np.nonzero(made)
    next_obs = rollout.next_obs[closing[steps, worlds], worlds]
    columns = (rollout.obs[made], next_obs, rollout.raw[made], advantages[made], (advantages + values)[made])
    data = Advantages(*(tensor(np.asarray(column, np.float32)) for column in columns))
    return Judged(data, float(values[made].mean()))


def check_rollout(settings: Algorithm, env: BatchEnv) -> None:
    """Raise :class:`InvalidValueError` where the first rollout is the last one, which has no learning rate."""
    check_steps(settings, "rollout.steps", whole_turns(settings.rollout.steps, env.num_envs))
