"""Fly a robot over a link by a policy, in the robot's own time, and record every flight."""

from __future__ import annotations

import getpass
import logging
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.core.schema import Choice
from aerial_il.links.guard import Guard
from aerial_il.links.simulated.link import Simulated
from aerial_il.policies.parts.execution import AS_TRAINED, Execution
from aerial_il.workflows.parts.names import MaybeRobot, MaybeTask, Tier, at_least

if TYPE_CHECKING:
    from aerial_il.collection.collect import Collection
    from aerial_il.core.contracts import Policy
    from aerial_il.links.environment import LinkedEnvironment
    from aerial_il.links.loop import Timing
    from aerial_il.links.pilot import LinkPilot

log = logging.getLogger(__name__)
LinkChoice = Annotated[Any, Choice("link")]


@dataclass(frozen=True, kw_only=True)
class Fly:
    """What is flown.

    Attributes:
        policy: a run, a policy, an exported policy, or: random, expert (simulated here in lockstep).
        link: to the robot.
        guard: what must hold for the robot to follow the policy; where it does not, it hovers.
        execution: how the policy flies its chunks.
        think_ms: from what is seen to the answer being flown (null: measured before the flight, 0 if it fits a tick or
            the robot's time waits).
        blend_ms: over which the step between two chunks is spread.
        robot: robot that is simulated here, with link=simulated (null: the one that the policy was trained on).
        task: its task (null: the one that the policy was trained on).
        tier: its disturbance tier.
        latency: how late it shows and takes things.
        action: action level (null: the policy's own).
        out: folder of the recordings, a dataset.
        episodes: number of flights, one for each seed.
        seed: first seed; it sets the scene of a simulated robot.
        mix: add to a dataset that was flown otherwise.
        land: land after the last flight.
        page: serve a page to watch on and to take over from the policy; while nobody watches, the robot hovers.
        port: of that page (0: any that is free).
        open: open it in the browser.
        progress: show a progress bar.
    """

    policy: str
    link: LinkChoice = field(default_factory=Simulated)
    guard: Guard = Guard()
    execution: Execution = AS_TRAINED
    think_ms: float | None = None
    blend_ms: float = 0.0
    robot: MaybeRobot = None
    task: MaybeTask = None
    tier: Tier = "calm"
    latency: Latency = NO_LATENCY
    action: str | None = None
    out: str
    episodes: int = 1
    seed: int = 10_000
    mix: bool = False
    land: bool = True
    page: bool = False
    port: int = 8642
    open: bool = True
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, episodes=1, seed=0, think_ms=0.0, blend_ms=0.0, port=0)


@dataclass(frozen=True)
class Flown:
    """What came of it.

    Attributes:
        collection: the recorded flights. timing: of all ticks. think_ticks: that the policy was given.
        troubles: seed -> ticks for which the robot hovered by itself, and why, of flights in which the guard objected.
        by_person: seed -> ticks that who took over flew.
    """

    collection: Collection
    timing: Timing
    think_ticks: int
    troubles: dict[int, tuple[int, str]]
    by_person: Mapping[int, int]


def fly(settings: Fly) -> Flown:
    """Fly the seeds that ``out`` does not hold yet.

    Raises:
        LinkError: no robot answers. InvalidValueError: the policy does not suit the robot, or thinks for too long.
    """
    from aerial_il.collection.collect import collect
    from aerial_il.links.environment import LinkedEnvironment
    from aerial_il.links.loop import Timing
    from aerial_il.links.vehicle import land
    from aerial_il.workflows.info import remember
    from aerial_il.workflows.parts import pilots

    known = pilots.pilot(settings.policy, robot=settings.robot, task=settings.task, action=settings.action)
    link = settings.link.connect(lambda: _robot(settings, known), level=known.reference.action)
    with closing(LinkedEnvironment(link, settings.guard)) as env:
        _require_robot(settings, env)
        seeds = range(settings.seed, settings.seed + settings.episodes)
        pilot, ticks = _pilot(settings, known.policy, env)
        with closing(pilot), _watched(settings, pilot, env) as (flier, name):
            flown = collect(
                env, flier, seeds, settings.out, policy_name=name, settings=_said(settings, known.policy),
                mix=settings.mix, progress=settings.progress, called="fly",
            )  # fmt: skip
        remember(flown, env.spec)
        if settings.land and flown.flights:
            land(link)
    timing, by_person = sum(env.loop.timings, Timing()), getattr(flier, "by_person", {})
    return Flown(flown, timing, ticks, env.loop.troubles, by_person)


def _robot(settings: Fly, pilot: Any) -> Any:
    """Return the robot that is simulated here."""
    from aerial_il.links.robot import SimulatedRobot

    where = pilot.reference
    if where.env is not None:
        raise InvalidValueError(f"{where.env} is no robot of the suite: aerial-il evaluate flies it.")
    return SimulatedRobot(
        where.robot, where.task, tier=settings.tier, level=where.action or "ee_pose", cameras=where.cameras,
        image_size=where.image_size, latency=settings.latency,
    )  # fmt: skip


def _require_robot(settings: Fly, env: LinkedEnvironment) -> None:
    """Refuse a robot that is another than was asked for: one that is elsewhere is as it was started."""
    for name in ("robot", "task", "tier"):
        asked, is_so = getattr(settings, name), getattr(env.spec, name)
        if asked not in (is_so, getattr(Fly, name)) and not isinstance(settings.link, Simulated):
            raise InvalidValueError(f"{name}={asked} was asked for; over link={settings.link.name} there is {is_so}.")


def _pilot(settings: Fly, policy: Policy, env: LinkedEnvironment) -> tuple[LinkPilot, int]:
    """Return what flies, and the ticks that it is given to think."""
    from aerial_il.links.pilot import LinkPilot, ticks_to_think
    from aerial_il.policies.parts.flying import FlyingPolicy

    dt = env.spec.control_dt_s
    blend = round(settings.blend_ms / 1000.0 / dt)
    if not isinstance(policy, FlyingPolicy):
        if settings.execution != AS_TRAINED:
            raise InvalidValueError(f"execution is for policies that fly chunks; policy={settings.policy} does not.")
        return LinkPilot(policy, think_ticks=round((settings.think_ms or 0.0) / 1000.0 / dt), blend_ticks=blend), 0
    policy.check(env.spec)
    ticks = round((settings.think_ms or 0.0) / 1000.0 / dt)
    if settings.think_ms is None and not env.loop.link.lockstep:
        tried = policy.fresh()
        tried.attach(env)
        ticks = ticks_to_think(tried, env.loop.look(), dt)
    if settings.execution != AS_TRAINED or ticks:
        policy = policy.executing(settings.execution, settings.latency, thinking=ticks)
    return LinkPilot(policy, think_ticks=ticks, blend_ticks=blend), ticks


@contextmanager
def _watched(settings: Fly, pilot: LinkPilot, env: LinkedEnvironment) -> Iterator[tuple[Policy, str]]:
    """Yield what flies, taken over by who is on the page where there is one, and its name."""
    if not settings.page:
        yield pilot, settings.policy
        return
    from aerial_il.core import presets
    from aerial_il.core.rendering import require_rendering
    from aerial_il.data.provenance import HUMAN
    from aerial_il.links.takeover import TakeOver
    from aerial_il.teleop.devices import bindings_of
    from aerial_il.teleop.flight import Site
    from aerial_il.workflows.parts.page import DEVICES, greet

    require_rendering("watching on the page")
    bindings = bindings_of({device: presets.read("device", device) for device in DEVICES})
    operator, opened = getpass.getuser(), partial(greet, open_page=settings.open)
    with TakeOver(pilot, env, bindings, Site(port=settings.port), operator=operator, opened=opened) as shared:
        log.info("It flies once somebody has opened the page.")
        shared.wait()
        yield shared, f"{settings.policy} with {HUMAN}{operator}"


def _said(settings: Fly, policy: Policy) -> dict[str, Any]:
    """Return what was asked for that changes a flight: the same command goes on, whatever is measured on the way."""
    from aerial_il.evaluation.rollouts import known_by

    link = settings.link
    own = {f"link.{name}": value for name, value in asdict(link).items() if value != getattr(type(link), name)}
    said = {"link": link.name, **own, **known_by(policy), **settings.latency.said, **settings.execution.said}
    return said | {name: value for name in ("think_ms", "blend_ms") if (value := getattr(settings, name))}
