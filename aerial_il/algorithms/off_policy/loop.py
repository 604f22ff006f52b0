"""The one off-policy loop: every algorithm calls it with its agent and with what one update is."""

from collections.abc import Callable, Mapping

from aerial_il.algorithms.off_policy.agent import Agent
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import Explorer, RandomActions
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.replay_buffer import Batch, mixed
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Stateful


def learn_off_policy(
    run: OnlineRun,
    settings: Algorithm,
    agent: Agent,
    flights: ExperienceReplay,
    update: Callable[[bool], Mapping[str, float]],
    *,
    pilot: Explorer | None = None,
    parts: Mapping[str, Stateful] | None = None,
    prepare: Callable[[], None] | None = None,
    offline: int = 0,
    every: int = 1,
) -> None:
    """Fly, store, learn, until no steps are left.

    Args:
        agent: flies once the warm-up is over.
        flights: take its steps and keep them.
        update: one gradient step, handed whether the actor improves -> named numbers.
        pilot: who flies through the warm-up, while nothing is learned; ``agent`` flies but does not learn either; None
            for the agent, whose critics learn meanwhile.
        parts: what else changes while the run goes on, by name.
        prepare: called once a turn, before its updates.
        offline: updates before the first flight.
        every: environment steps from one block of updates to the next.
    """
    random = {"random_actions": pilot} if isinstance(pilot, RandomActions) else {}
    run.start(agent.actor, {"agent": agent, **(parts or {}), **random, **flights.parts})

    for _ in run.offline(offline):
        run.log(update(True))
    while run.goes_on():
        warming_up = run.collector.steps < settings.warmup
        waiting = pilot if warming_up else None
        flights.step(waiting or agent)
        if not warming_up:
            flights.finish_warmup()
        agent.set_lr(lr_at(settings, run.left))
        if waiting is None:
            if prepare:
                prepare()
            for _ in range(run.updates_due(settings.replay.updates_per_step, every)):
                run.log(update(not warming_up))
        run.end_turn()


def learn_from_reward(
    run: OnlineRun, settings: Algorithm, agent: Agent, learn: Callable[..., Mapping[str, float]]
) -> None:
    """Let ``agent`` ``learn(minibatch, improve=...)`` from its own flights alone.

    Through the warm-up actions are random; a prior flies it itself, while its critics learn.
    """
    hindsight, size = settings.hindsight, settings.replay.batch_size
    flights = ExperienceReplay(run, settings.replay.capacity, hindsight=hindsight, obs_norm=settings.obs_norm)
    pilot = None if settings.prior else RandomActions(run.sizes[1], run.rng("warm-up"))

    def update(improve: bool) -> Mapping[str, float]:
        return learn(flights.buffer.sample(size), improve=improve)

    learn_off_policy(run, settings, agent, flights, update, pilot=pilot)


def learn_offline_first(
    run: OnlineRun, settings: Algorithm, agent: Agent, learn: Callable[[Batch], Mapping[str, float]]
) -> None:
    """Let ``agent`` learn, each time from a minibatch: ``offline_steps`` times from the dataset, then as it flies.

    It flies through the warm-up as it is; without ``offline_steps`` actions are random there. In each minibatch that
    follows, the share ``demos_share`` is of the dataset.
    """
    absorbing, size = settings.demonstrations.absorbing, settings.replay.batch_size
    demos = run.demos.buffer(run.interface, run.rng("demonstrations"), absorbing=absorbing, reward=None)
    flights = ExperienceReplay(run, settings.replay.capacity, hindsight=settings.hindsight, absorbing=absorbing)
    pilot = agent if settings.offline_steps else RandomActions(run.sizes[1], run.rng("warm-up"))

    def update(improve: bool) -> Mapping[str, float]:
        del improve  # nothing is learned in the warm-up
        flown = len(flights.buffer) > 0
        return learn(mixed(demos, flights.buffer, size, settings.demos_share) if flown else demos.sample(size))

    parts = {"demonstrations": demos}
    learn_off_policy(run, settings, agent, flights, update, pilot=pilot, parts=parts, offline=settings.offline_steps)


def lr_at(settings: Algorithm, left: float) -> float:
    """Return the learning rate when the share ``left`` of the training is left."""
    return settings.lr * (settings.lr_floor + (1.0 - settings.lr_floor) * left)
