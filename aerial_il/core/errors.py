"""Errors a user can act on: each names the value, the limit, the valid choices and the next command."""

import difflib
from collections.abc import Iterable
from typing import Any


class AerialError(Exception):
    """Base of every error whose cause lies in what a user gave or in what a run met.

    The command line prints its message without a traceback and exits with status 2.
    """

    def __reduce__(self) -> tuple[Any, ...]:  # an error of a process that flies worlds reaches who asked it
        return type(self).__new__, (type(self), *self.args), self.__dict__


class UnknownNameError(AerialError, KeyError):
    """A name that no registry or configuration knows.

    Args:
        kind: what the name stands for, e.g. ``"robot"``.
        value: the name that was given.
        choices: the valid names.
        hint: an optional sentence with the next command to try.
    """

    def __init__(self, kind: str, value: object, choices: Iterable[str], hint: str = "") -> None:
        self.kind, self.value, self.choices = kind, value, tuple(choices)
        near = difflib.get_close_matches(str(value), self.choices, n=1, cutoff=0.5)
        guess = f" Did you mean {near[0]!r}?" if near else ""
        valid = ", ".join(self.choices) or "none"
        message = f"Unknown {kind} {value!r}.{guess} Valid: {valid}."
        super().__init__(f"{message} {hint}" if hint else message)

    def __str__(self) -> str:  # KeyError would print the repr
        return str(self.args[0])


class InvalidValueError(AerialError, ValueError):
    """A value outside its documented limits or of the wrong shape or type."""


class SimulationDivergedError(AerialError, RuntimeError):
    """NaN, infinity or a MuJoCo warning in the physics, or a non-finite action.

    Args:
        what: what became invalid, e.g. ``"qacc of DOF 3"``.
        seed: seed of the episode.
        step: control step within the episode at which it happened.
    """

    def __init__(self, what: str, *, seed: int, step: int) -> None:
        self.what, self.seed, self.step = what, seed, step
        super().__init__(f"{what} at step {step} of the episode with seed {seed}.")


class CheckpointError(AerialError):
    """A checkpoint or saved policy that is cut, altered, foreign or cannot be written.

    Args:
        path: the file or folder at fault.
        problem: one sentence saying what is wrong.
        hint: the next command or step.
    """

    def __init__(self, path: object, problem: str, hint: str = "") -> None:
        self.path, self.problem, self.hint = str(path), problem, hint
        super().__init__(f"{path}: {problem}" + (f" {hint}" if hint else ""))


class NonFiniteActionError(AerialError, RuntimeError):
    """A policy saw or produced NaN or infinity.

    Args:
        what: what is not finite, e.g. ``"observation base_pos"`` or ``"network output"``.
        worlds: indices of the worlds concerned.
    """

    def __init__(self, what: str, worlds: Iterable[int]) -> None:
        self.what, self.worlds = what, tuple(int(w) for w in worlds)
        shown = ", ".join(str(w) for w in self.worlds[:8]) + (", ..." if len(self.worlds) > 8 else "")
        super().__init__(f"Non-finite {what} in world {shown}; no action can be trusted.")


class NoRewardError(AerialError, RuntimeError):
    """A training in which every step and every episode was paid alike, so that there was nothing to learn.

    Args:
        steps: environment steps flown. reward: what each brought. advice: what the algorithm can do about it.
    """

    def __init__(self, steps: int, reward: float, advice: str) -> None:
        self.steps, self.reward, self.advice = steps, reward, advice
        super().__init__(
            f"In {steps} environment steps no reward but {reward:g} has come, and no episode returned more than any "
            f"other: there is nothing to learn from. The last checkpoint is intact. {advice} Or wait longer: the same "
            "command with a larger algorithm.reward_patience goes on from here."
        )


class TrainingDivergedError(AerialError, RuntimeError):
    """A loss or gradient that is not finite; nothing of that step is kept.

    Args:
        what: e.g. ``"loss"``.
        step: optimisation step at which it happened, counted from 0.
        hint: what to change.
    """

    def __init__(self, what: str, *, step: int, hint: str = "") -> None:
        self.what, self.step = what, step
        super().__init__(f"{what} is not finite at training step {step}." + (f" {hint}" if hint else ""))


class DemoError(AerialError):
    """A recording or dataset that cannot be trusted.

    Args:
        path: the file or folder.
        problem: one sentence saying what is wrong.
        topic: MCAP topic or dataset column, where one is at fault.
        step: index of the first bad step, where one is at fault.
        field: field within the message, where one is at fault.
        expected: what was expected.
        got: what was there.
        hint: the next command to run.
    """

    def __init__(
        self,
        path: object,
        problem: str,
        *,
        topic: str | None = None,
        step: int | None = None,
        field: str | None = None,
        expected: object = None,
        got: object = None,
        hint: str = "",
    ) -> None:
        self.path, self.problem = str(path), problem
        self.topic, self.step, self.field = topic, step, field
        self.expected, self.got, self.hint = expected, got, hint
        where = [f"{k} {v}" for k, v in (("topic", topic), ("step", step), ("field", field)) if v is not None]
        parts = [f"{self.path}: {problem}"]
        if where:
            parts.append(f"[{', '.join(where)}]")
        if expected is not None:
            parts.append(f"expected {expected}, got {got}.")
        elif got is not None:
            parts.append(f"Got {got}.")
        if hint:
            parts.append(hint)
        super().__init__(" ".join(parts))


class StorageError(AerialError):
    """A disk that is full or a place that cannot be written.

    Args:
        path: the file or folder that was being written.
        error: what the operating system said.
        hint: what is safe, and the next command to run.
    """

    def __init__(self, path: object, error: OSError, hint: str = "") -> None:
        self.path, self.error = str(path), error
        super().__init__(f"{path}: cannot be written ({error.strerror or error}). {hint}".rstrip())


def shortened(text: str, most: int = 60) -> str:
    """Return at most so many characters of what an error names, and how many there are."""
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"
