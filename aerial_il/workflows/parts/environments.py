"""An environment as a command or a specification names it, ours or one from outside, and the only place to build it.

A specification may come out of somebody's file, so that what it says never imports code: only a key that the user typed
may name a module (see :mod:`aerial_il.suite.outside`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, camera_text
from aerial_il.suite import outside
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.outside.processes import processes_for
from aerial_il.suite.scenario import Scenario, horizon_of

DEFAULT_TIER, DEFAULT_ACTION, DEFAULT_CONTROLLER = "calm", "ee_pose", "geometric_observer"
IMAGE_SIZE = (240, 320)
OURS = ("robot", "task", "tier", "action")  # what may be said of an environment of the suite, in this order


@dataclass(frozen=True)
class EnvironmentReference:
    """What was said of an environment; nothing need be.

    Attributes:
        env: key of one from outside. options: how that one is made.
        robot, task, tier, action, controller, horizon: of one of the suite's; None for the default.
        cameras, image_size: what is rendered there, and how large, where cameras do not say so: height and width.
    """

    env: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    robot: str | None = None
    task: str | None = None
    tier: str | None = None
    action: str | None = None
    controller: str | None = None
    horizon: int | None = None
    cameras: tuple[str, ...] = ()
    image_size: tuple[int, int] = IMAGE_SIZE

    def __post_init__(self) -> None:
        check_horizon(self.env, self.horizon)
        if self.env and (own := self._ours()):
            said = " ".join(f"{name}={value}" for name, value in own.items())
            raise InvalidValueError(f"env={self.env} names an external environment: leave out {said}.")
        if self.options and not self.env:
            said = " ".join(f"{name}={value}" for name, value in self.options.items())
            raise InvalidValueError(f"{said} is for an external environment: set env=KEY too.")

    @property
    def expected(self) -> dict[str, str]:
        """What a dataset from here was recorded with, by the names of a specification."""
        if self.env is None:
            return self._ours()
        robot, _, task = self.env.partition(":")
        return {"robot": robot, "task": task}

    @property
    def overrides(self) -> list[str]:
        """What was said, as it is typed."""
        given = {"env": self.env, **self.options, **self._ours(), "horizon": self.horizon}
        return [f"{name}={value}" for name, value in given.items() if value is not None]

    def load(self, *, num_envs: int, threads: int, tier: str | None = None, controller: str | None = None) -> Any:
        """Return its batch environment.

        Args:
            num_envs: worlds.
            threads: of the simulation, or processes of external environments; 0 for all cores.
            tier, controller: instead of its own; one from outside knows neither.

        Raises:
            InvalidValueError: what was said does not name one.
        """
        if self.env is not None:
            processes = processes_for(threads, num_envs)
            return outside.load(self.env, num_envs=num_envs, processes=processes, **self.options)
        if self.robot is None or self.task is None:
            hint = "set env=KEY, or robot=... and task=..., or dataset=PATH to use its environment."
            raise InvalidValueError(f"Where shall it learn? Without demonstrations, {hint} See: aerial-il list")
        scenario = Scenario(
            self.robot,
            self.task,
            tier or self.tier or DEFAULT_TIER,
            self.action or DEFAULT_ACTION,
            self.cameras,
            self.image_size,
            controller or self.controller or DEFAULT_CONTROLLER,
            self.horizon,
        )
        env = BatchEnvironment(scenario, num_envs, threads)
        env.reset(0)
        return env

    def _ours(self) -> dict[str, str]:
        return {name: value for name in OURS if (value := getattr(self, name)) is not None}


def refuse_unread(env: str | None, settings: Any, names: Iterable[str], *, group: str = "") -> None:
    """Raise :class:`InvalidValueError` where ``settings`` say something that an ``env`` from outside does not read.

    Args:
        names: of what it does not read. group: before these where they are typed, such as ``expert.``.
    """
    own = {name: getattr(settings, name) for name in names if getattr(settings, name) != getattr(type(settings), name)}
    if env and own:
        said = " ".join(f"{group}{name}={value}" for name, value in own.items())
        raise InvalidValueError(f"{said} is for the suite: leave it out with env={env}.")


def check_horizon(env: str | None, horizon: int | None) -> None:
    """Raise :class:`InvalidValueError` where ``horizon``, which is the suite's, was said of ``env`` from outside."""
    if env and horizon is not None:
        raise InvalidValueError(f"horizon= is for the suite: with env={env} set max_steps={horizon}.")


def key_of(spec: EnvSpec, typed: str | None = None) -> str:
    """Return the key of the environment from outside that ``spec`` describes.

    Args:
        spec: may come out of a file. typed: the key that the user typed, which alone may name a module.

    Raises:
        InvalidValueError: it was made by a caller, or names a module that nobody typed.
    """
    key = outside.key_of(spec, typed=typed)
    if key is None:
        where = f"{spec.robot}/{spec.task}"
        raise InvalidValueError(
            f"{where} is not an environment that can be loaded by name: set env=KEY, or use Python."
        )
    return key


def reference_of(spec: EnvSpec, *, images: Sequence[str] = (), typed: str | None = None) -> EnvironmentReference:
    """Return the reference of the environment that ``spec`` describes.

    Args:
        spec: of demonstrations or of a policy. images: fields of it to render. typed: see :func:`key_of`.
    """
    if spec.is_outside:
        return EnvironmentReference(env=key_of(spec, typed), options=outside.checked_options(spec))
    return EnvironmentReference(
        robot=spec.robot,
        task=spec.task,
        tier=spec.tier,
        action=spec.action.level,
        controller=spec.controller,
        horizon=horizon_of(spec),
        cameras=tuple(camera_text(spec.observation[name], spec.control_dt_s) for name in images),
    )


def given(**options: Any) -> dict[str, Any]:
    """Return the options that are not None."""
    return {name: value for name, value in options.items() if value is not None}
