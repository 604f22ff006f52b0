"""An environment as a command names it: where one learns without demonstrations, or where they are to come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from aerial_il.core.errors import InvalidValueError

OURS = ("robot", "task", "tier", "action")


@dataclass(frozen=True)
class Place:
    """What was said of an environment; nothing need be.

    Attributes:
        env: key of one from outside. options: how that one is made.
        robot, task, tier, action: of one of the suite's.
    """

    env: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    robot: str | None = None
    task: str | None = None
    tier: str | None = None
    action: str | None = None

    def __post_init__(self) -> None:
        if self.env and (own := self._ours()):
            said = " ".join(f"{name}={value}" for name, value in own.items())
            raise InvalidValueError(f"env={self.env} names an environment from outside: leave out {said}.")
        if self.options and not self.env:
            said = " ".join(f"{name}={value}" for name, value in self.options.items())
            raise InvalidValueError(f"{said} is for an environment from outside: say env=KEY too.")

    @property
    def expected(self) -> dict[str, str]:
        """What a dataset from here was recorded with, by the names of a specification."""
        if self.env is None:
            return self._ours()
        robot, _, task = self.env.partition(":")
        return {"robot": robot, "task": task}

    @property
    def words(self) -> list[str]:
        """What was said, as it is typed."""
        given = {"env": self.env, **self.options, **self._ours()}
        return [f"{name}={value}" for name, value in given.items() if value is not None]

    def load(self, tier: str | None, *, num_envs: int, threads: int) -> Any:
        """Return its batch environment.

        Args:
            tier: how rough the air is instead. num_envs: worlds.
            threads: of the simulation, or processes of worlds from outside; 0 for all cores.

        Raises:
            InvalidValueError: what was said does not name one.
        """
        import aerial_il
        from aerial_il.cli.flights.pilots import DEFAULT_ACTION
        from aerial_il.suite import outside
        from aerial_il.suite.outside.processes import processes_for

        if self.env is not None:
            processes = processes_for(threads, num_envs)
            return outside.load(self.env, num_envs=num_envs, processes=processes, **self.options)
        if self.robot is None or self.task is None:
            hint = "say env=KEY, or robot=... and task=..., or dataset=PATH, whose environment it then is."
            raise InvalidValueError(f"Where shall it learn? Without demonstrations, {hint} See: aerial-il list")
        return aerial_il.load_batch(
            self.robot,
            self.task,
            num_envs=num_envs,
            tier=tier or self.tier or "calm",
            action=self.action or DEFAULT_ACTION,
            num_threads=threads,
        )

    def _ours(self) -> dict[str, str]:
        return {name: value for name in OURS if (value := getattr(self, name)) is not None}
