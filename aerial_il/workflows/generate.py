"""Generate many demonstrations out of few: their segments, moved to where things are, are flown and recorded."""

from __future__ import annotations

import logging
from collections import Counter
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from aerial_il.core.checks import require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.parts.names import MaybeRobot, MaybeTier, at_least
from aerial_il.workflows.parts.shards import shards_of

if TYPE_CHECKING:
    from aerial_il.generation.generator import Generator
    from aerial_il.generation.source import Source
    from aerial_il.suite.batch import BatchEnvironment

log = logging.getLogger(__name__)
POLICY, WRIST = "generated", "wrist"
LOOKED_AT = 16  # starts, before anything is flown
LONGEST, SPARE_STEPS = 3, 250  # a flight is cut off after so many times its longest source, and that


@dataclass(frozen=True, kw_only=True)
class Generate:
    """What is generated.

    Attributes:
        dataset: recordings to generate from: by an expert or by hand, of one task.
        sources: how many of its successes, from the first on (null: all).
        out: folder of the new dataset; its failures are kept, labelled so.
        robot: that flies (null: the one of the sources).
        tier: that it flies in (null: the one of the sources).
        episodes: flights, one for each seed.
        seed: first seed; evaluations start at 10000.
        select: which source a flight is made of: random, or nearest, whose things lay most alike.
        noise: perturbation of the commands, from 0 (none) to 1; what is learned from is the command without it.
        disturbed: m, how far aside flights are led in their first second at most; what is learned from is the way back.
        force: a flight is a failure whose tool presses with more than so many times what the sources' does (null: none
            is); of both, the 95th percentile while it touches anything.
        cameras: cameras to record: scene, wrist, base; with a size, rate and delay of its own wrist@64x64@25Hz@40ms.
        image_size: height and width of images that say none.
        mix: add to a dataset of another tier, flight law, pilot or settings.
        num_envs: worlds flown at once.
        threads: simulation threads; 0 for all cores.
        shard: episodes of each job, where launcher= divides the work.
        progress: show a progress bar.
    """

    dataset: str
    sources: int | None = None
    out: str
    robot: MaybeRobot = None
    tier: MaybeTier = None
    episodes: int = 1000
    seed: int = 0
    select: Literal["random", "nearest"] = "random"
    noise: float = 0.0
    disturbed: float = 0.0
    force: float | None = None
    cameras: tuple[str, ...] = ()
    image_size: tuple[int, int] = (240, 320)
    mix: bool = False
    num_envs: int = 64
    threads: int = 0
    shard: int = 1000
    progress: bool = True

    def __post_init__(self) -> None:
        if self.force is not None:
            require_positive(self, "force")
        at_least(self, sources=1, episodes=1, seed=0, noise=0.0, disturbed=0.0, num_envs=1, threads=0, shard=1)


def generate(settings: Generate) -> str:
    """Fly what is missing, and return the folder.

    Raises:
        InvalidValueError: nothing can be generated from the recordings, or ``out`` is where they are.
    """
    from aerial_il.collection.collect import collect
    from aerial_il.core.rendering import require_rendering
    from aerial_il.data.curation.derived import check_out
    from aerial_il.generation.generator import Generator
    from aerial_il.workflows.info import remember
    from aerial_il.workflows.parts.environments import EnvironmentReference

    check_out(settings.out, [settings.dataset])  # before anything is read
    if settings.cameras:
        require_rendering(f"cameras=[{','.join(settings.cameras)}]")
    sources = _sources(settings)
    spec = sources[0].spec
    policy = Generator(
        sources,
        select=settings.select,
        noise=settings.noise,
        disturbed=settings.disturbed,
        most_force=_most_force(settings, sources),
    )
    where = EnvironmentReference(
        robot=settings.robot or spec.robot,
        task=spec.task,
        tier=settings.tier or spec.tier,
        controller=spec.controller,
        cameras=settings.cameras,
        image_size=settings.image_size,
    )
    longest = LONGEST * max(map(len, sources)) + SPARE_STEPS
    with closing(where.load(num_envs=min(settings.num_envs, settings.episodes), threads=settings.threads)) as env:
        _look_ahead(env, policy, settings)
        for request in env.scenario.camera_requests:
            if request.camera == WRIST:
                _look_through(env, sources, request.size)
        done = collect(
            env, policy, range(settings.seed, settings.seed + settings.episodes), settings.out,
            policy_name=POLICY, settings=_made_of(settings, sources), longest=min(longest, env.spec.max_steps),
            mix=settings.mix, progress=settings.progress, called="generate",
        )  # fmt: skip
        remember(done, env.spec)
    if done.failures and not done.demos:
        log.warning("None of %d flights succeeded: %s", len(done.failures), _advice(sources, settings))
    return settings.out


def _look_ahead(env: BatchEnvironment, policy: Generator, settings: Generate) -> None:
    """Say of how many starts, as many whatever is flown at once, the flights are beyond the robot.

    Raises:
        InvalidValueError: all of them.
    """
    policy.attach(env)
    why: list[str | None] = []
    for first in range(settings.seed, settings.seed + LOOKED_AT, env.num_envs):
        env.reset(first)
        why += policy.beyond()
    reasons = Counter(reason for reason in why[:LOOKED_AT] if reason)
    if not reasons:
        return
    count, robot = reasons.total(), env.spec.robot
    told = "; ".join(f"{times} {reason}" for reason, times in reasons.most_common())
    share = f"From {count} of {LOOKED_AT} starts, seed {settings.seed} and on, flights are beyond {robot}: {told}."
    if count == LOOKED_AT:
        raise InvalidValueError(f"{share} Name another robot, or take a source that it can fly.")
    log.warning("%s They are flown all the same, and kept as failures if they fail.", share)


def _look_through(env: BatchEnvironment, sources: list[Source], size: tuple[int, int]) -> None:
    """Say how much of what is dealt with the camera beside the tool will see."""
    from aerial_il.generation.sight import in_view

    height, width = size
    shares = in_view(env.model, WRIST, width / height, sources)
    told = ", ".join(f"{name} in {100 * share:.0f} %" for name, share in shares.items())
    log.info("In view of the camera %s: %s of the steps about it.", WRIST, told)


def _most_force(settings: Generate, sources: list[Source]) -> float | None:
    """Return what tools may press with, N, by what they do in the sources; None for any."""
    from aerial_il.data.dataset import open_dataset
    from aerial_il.generation.force import pressing_in

    if settings.force is None:
        return None
    pressed = pressing_in(open_dataset(settings.dataset).only(source.uid for source in sources))
    log.info("The sources press with %.1f N; up to %.1f N are allowed.", pressed, settings.force * pressed)
    return settings.force * pressed


def _made_of(settings: Generate, sources: list[Source]) -> dict[str, Any]:
    """Return what tells flights made in one way from others, as JSON values."""
    from aerial_il.generation.cuts import text_of

    made = {"sources": [source.uid for source in sources], "select": settings.select, "noise": settings.noise}
    cuts = {source.uid: text_of(source.cuts) for source in sources if source.cuts is not None}
    further = {"disturbed": settings.disturbed, "force": settings.force, "cuts": cuts}
    return made | {name: value for name, value in further.items() if value}


def shards(settings: Generate) -> list[tuple[tuple[str, ...], str]]:
    """Return, for each part of the seeds, the words that choose it and a folder for its log."""
    seeds = range(settings.seed, settings.seed + settings.episodes)
    return shards_of(settings.out, seeds, settings.shard)


def _sources(settings: Generate) -> list[Source]:
    """Return the flights to generate from, and say what they are cut into."""
    from itertools import islice

    from aerial_il.data.dataset import open_dataset
    from aerial_il.generation.segments import cut
    from aerial_il.generation.source import read_sources, with_cuts

    dataset = open_dataset(settings.dataset)
    flights = (episode for episode in dataset if episode.success)
    sources = with_cuts(read_sources(islice(flights, settings.sources)), dataset.files)
    robots = sorted({source.spec.robot for source in sources})
    if len(robots) > 1 and settings.robot is None:
        said = ", ".join(robots)
        raise InvalidValueError(f"The sources were flown by {said}: say who is to fly, e.g. robot={robots[0]}.")
    if settings.sources and len(sources) < settings.sources:
        raise InvalidValueError(
            f"{settings.dataset} has {len(sources)} successful demonstrations; sources={settings.sources} asks for "
            "more."
        )
    if settings.progress:
        for source in sources[:10]:
            parts = ", ".join(f"{len(each) * source.spec.control_dt_s:.1f} s at {each.name}" for each in cut(source))
            log.info("%s: %s.", source.uid, parts)
    return sources


def _advice(sources: list[Source], settings: Generate) -> str:
    robot = sources[0].spec.robot
    if settings.force is not None:
        why = f"aerial-il info {settings.out} where=\"'pressed with' in note\""
        return f"raise force={settings.force:g} if they pressed too hard, as {why} says."
    if settings.robot not in (None, robot):
        return f"they were made for {settings.robot} out of flights of {robot}. Record one with {settings.robot}."
    return f"look at one with aerial-il view recording={settings.out}, or take another source."
