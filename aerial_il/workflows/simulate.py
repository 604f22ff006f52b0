"""Serve a robot of the suite over a link, for others to fly."""

from contextlib import closing, suppress
from dataclasses import dataclass, field

from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.links.ros2.link import Ros2
from aerial_il.workflows.fly import LinkChoice
from aerial_il.workflows.parts.names import Controller, Robot, Task, Tier, at_least


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """What is simulated.

    Attributes:
        link: over which it is flown.
        robot: robot that flies.
        task: task that sets the scene, and judges.
        tier: disturbance tier, e.g. gusts.
        controller: control law of the base.
        latency: how late it shows and takes things.
        action: level of the actions in its description; it takes set points at others too.
        cameras: images that it shows: scene, wrist, base; with a size, rate and delay of its own wrist@64x64@25Hz@40ms.
        image_size: height and width of images of cameras that have no size of their own.
        seed: of the scene that it begins with.
    """

    link: LinkChoice = field(default_factory=Ros2)
    robot: Robot = "ua_quad_arm4"
    task: Task = "pick_place"
    tier: Tier = "calm"
    controller: Controller = "geometric_observer"
    latency: Latency = NO_LATENCY
    action: str = "ee_pose"
    cameras: tuple[str, ...] = ()
    image_size: tuple[int, int] = (240, 320)
    seed: int = 0

    def __post_init__(self) -> None:
        at_least(self, seed=0)


def simulate(settings: Simulate) -> None:
    """Serve it until interrupted.

    Raises:
        InvalidValueError: the link serves no robots, a package is missing, or a port is in use.
    """
    from aerial_il.core.rendering import require_rendering
    from aerial_il.links.robot import SimulatedRobot

    if settings.cameras:
        require_rendering(f"cameras=[{','.join(settings.cameras)}]")
    robot = SimulatedRobot(
        settings.robot, settings.task, tier=settings.tier, level=settings.action, controller=settings.controller,
        cameras=settings.cameras, image_size=settings.image_size, latency=settings.latency,
    )  # fmt: skip
    with closing(robot), suppress(KeyboardInterrupt):
        robot.reset(settings.seed)
        settings.link.serve(robot)
