"""Answers to what a dataset's format cannot say, for every command that opens one."""

from dataclasses import dataclass, fields
from typing import Any

from aerial_il.core.computer import MEMORY_MB


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How demonstrations are read, in whatever format they are.

    Attributes:
        success: which of them are successes: all, reward (a last one above zero), return:R (at least R), terminal (the
            environment ended it), survived (it did not) (null: as the format says).
        control_dt: s between two actions (null: as the format says).
        filter_key: the part of the dataset to take, such as train of robomimic's mask (null: all).
        terminals: whether an end is a terminal state where the format does not say what done means (null: it is not);
            false: none is, whatever the format says.
        strict: refuse a dataset for one episode that cannot be used, instead of leaving that out.
        memory_mb: the most that one episode may take, MB.
    """

    success: str | None = None
    control_dt: float | None = None
    filter_key: str | None = None
    terminals: bool | None = None
    strict: bool = False
    memory_mb: int = MEMORY_MB

    @property
    def answers(self) -> dict[str, Any]:
        """What was said, by name."""
        said = {each.name: (getattr(self, each.name), each.default) for each in fields(Reading)}
        return {name: value for name, (value, default) in said.items() if value != default}


AS_IT_SAYS = Reading()
