"""What a policy is to do: which of its tasks it flies, and where it is told in words, what it takes these for."""

import logging
from functools import cached_property

import numpy as np

from aerial_il.core import language
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec
from aerial_il.policies.parts.tasks import completed, tasks_of, wordings_of

log = logging.getLogger(__name__)
MOST_NAMED = 5  # of the instructions that it knows, in an error


class Assignment:
    """What a policy for ``spec``, which may stand for several tasks, is to do.

    Attributes:
        task: which task it flies.
    """

    def __init__(self, spec: EnvSpec) -> None:
        self.task, self._spec = spec.task, spec
        self._told: str | None = None
        self._given: str | None = None if self._known else spec.instruction
        self._last, self._meant = "", ("", np.zeros(0))

    def take_on(self, spec: EnvSpec) -> None:
        """Do the task of an environment, as its instruction says."""
        self.task, self._given = spec.task, spec.instruction

    def as_in(self, other: "Assignment") -> None:
        """Do what another does."""
        self.task, self._told, self._given = other.task, other._told, other._given

    @property
    def by_words(self) -> bool:
        """Whether it is told in words what to do."""
        return language.FIELD in self._spec.observation.names

    @property
    def told(self) -> str | None:
        """What it is told in words to do; None for the environment's instruction.

        Raises:
            InvalidValueError: when set to what is like nothing that it learned from.
        """
        return self._told

    @told.setter
    def told(self, text: str | None) -> None:
        known = [*self._known]
        if text is not None and known and language.understood(text, known) is None:
            raise InvalidValueError(
                f"Nothing that the policy learned from is like the instruction {text!r}. It knows, among others: "
                f"{' | '.join(known[:: max(1, len(known) // MOST_NAMED)][:MOST_NAMED])}"
            )
        self._told = text

    @property
    def understood(self) -> str | None:
        """The wording that it knows and takes its instruction for; None where it is told nothing in words."""
        return self._taken_for(self._said)[0] if self.by_words and self._said is not None else None

    def shown(self, obs: Observation) -> dict[str, np.ndarray]:
        """Return ``obs`` (n, ...) with what says what to do, and the fields that other tasks have.

        Raises:
            InvalidValueError: it is told in words, and has not been.
            UnknownNameError: its task is none of the policy's.
        """
        obs, tasks = dict(obs), tasks_of(self._spec)
        if self.by_words:
            if self._said is None:
                raise InvalidValueError("The policy is told in words what to do: set its `told`, or attach it first.")
            obs[language.FIELD] = np.tile(self._taken_for(self._said)[1], (len(next(iter(obs.values()))), 1))
        if tasks == (self._spec.task,):
            return obs
        if self.task not in tasks:
            hint = "Attach it to an environment first, or set its task."
            raise UnknownNameError("task of the policy", self.task, tasks, hint)
        return completed(obs, self._spec, self.task)

    @cached_property
    def _known(self) -> dict[str, str]:
        return wordings_of(self._spec)

    @property
    def _said(self) -> str | None:
        return self._given if self._told is None else self._told

    def _taken_for(self, text: str) -> tuple[str, np.ndarray]:
        """Return the wording nearest to an instruction, or that itself where none is like it, and how it is shown (S,).

        What it is taken for is said once.
        """
        if text != self._last:
            meant = language.understood(text, self._known) if self._known else text
            if meant is None:
                log.warning("Nothing that the policy learned from is like the instruction %r.", text)
            elif meant != text:
                log.warning("Understood %r as %r.", text, meant)
            meant = meant or text
            self._last, self._meant = text, (meant, language.embedded(self._known.get(meant, meant)))
        return self._meant
