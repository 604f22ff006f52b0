"""Fly a robot over a link by a policy, keep time, and record every flight as a dataset.

The robot is one of the suite, in this process (link=simulated), or whoever answers over link=ros2 or link=mavlink. Set
points leave at absolute deadlines; late ticks are counted. While readings are missing, stale or not finite, or after
the robot's clock has jumped, nothing is sent and the robot hovers by itself; beyond the fence the flight ends. A policy
that needs more than half a tick thinks beside the flight. Interrupted, the robot hovers, and the same command goes on.

Example: aerial-il fly policy=runs/pick_bc out=datasets/flown episodes=20
Example: aerial-il fly policy=runs/pick_bc latency.observation_delay_ms=60 execution.chunks=dropped out=datasets/late
Example: aerial-il fly policy=exported/pick link=ros2 out=datasets/ros
"""

from aerial_il.workflows.fly import Flown, Fly, fly

SETTINGS, OUTPUT = Fly, "out"


def run(settings: Fly) -> None:
    """Fly, and print what came of it and how it kept time."""
    flown = fly(settings)
    print(f"Recordings: {flown.collection.folder.path}")
    _say_successes(flown)
    _say_time(flown)
    for seed, (ticks, why) in flown.troubles.items():
        print(f"Seed {seed}: {why}; the robot hovered by itself for {ticks} ticks.")
    for seed, ticks in flown.by_person.items():
        print(f"Seed {seed}: who took over flew {ticks} ticks of it.")


def _say_successes(flown: Flown) -> None:
    from aerial_il.evaluation.statistics import wilson

    done = flown.collection
    won, total = len(done.demos), len(done.demos) + len(done.failures)
    if total:
        ends = wilson(won, total)
        print(f"Success {won} of {total} ({100 * ends.lo:.1f} to {100 * ends.hi:.1f} %).")
    if objected := sum(flight.failure == "other" for flight in done.flights.values()):
        print(f"{objected} more came to the goal, but the robot had hovered by itself on the way: they do not count.")
    if done.skipped:
        print(f"{len(done.skipped)} flights were there already.")


def _say_time(flown: Flown) -> None:
    said = flown.timing.summary()
    if not said["ticks"]:
        return
    print(
        f"{said['ticks']} ticks, {said['late']} late by more than 5 ms (p99 {said['late_ms_p99']:g} ms). "
        f"From a tick to its set point: {said['work_ms_p50']:g} ms (median), {said['work_ms_p99']:g} ms (p99)."
    )
    if flown.think_ticks:
        print(f"The policy thought for {flown.think_ticks} ticks beside the flight.")
