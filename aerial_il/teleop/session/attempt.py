"""How one flight gets on: what is solved and lost, for how long success has held, and its states to look back at."""

import numpy as np

from aerial_il.suite.batch import BatchEnvironment, StepResult
from aerial_il.teleop.piloting.arbiter import Turn
from aerial_il.teleop.session.reel import Reel

SUCCESS_TICKS = 25  # success holds for half a second before it is believed


class Attempt:
    """One flight, from a reset on.

    Args:
        env: what is flown, at the start of the flight.

    Attributes:
        steps, person_steps: recorded ones, and those in which the person had taken over. success: whether the task is
            solved now. label: whether the person calls it so. lost: sub-tasks whose loss nothing makes good. marks:
            sub-task -> recorded step that first solved it. disturbed: what the person let happen, in words.
    """

    def __init__(self, env: BatchEnvironment) -> None:
        self._env, self.reel = env, Reel()
        self.steps = self.person_steps = self._held = 0
        self.success, self.label = False, True
        self._flags = np.zeros(len(env.spec.subtasks), bool)
        self.lost: tuple[str, ...] = ()
        self.marks: dict[str, int] = {}
        self.disturbed: list[str] = []

    @property
    def subtasks(self) -> dict[str, bool]:
        """Sub-tasks, and whether they are met."""
        return dict(zip(self._env.spec.subtasks, map(bool, self._flags), strict=True))

    @property
    def is_believed(self) -> bool:
        """Whether success has held for long enough."""
        return self._held >= SUCCESS_TICKS

    def see(self, result: StepResult) -> frozenset[str]:
        """Take note of a step; return the sub-tasks that were lost for good in it."""
        self._flags = result.info["subtasks"][0]
        self.success = bool(result.info["success"][0])
        self._held = self._held + 1 if self.success else 0
        self.success = self.success and not result.terminated[0]
        before, self.lost = self.lost, tuple(n for n in self._env.scenario.task.once_lost if not self.subtasks[n])
        return frozenset(self.lost) - frozenset(before)

    def count(self, turn: Turn) -> None:
        """Count a recorded step, and note which sub-tasks it was the first to solve."""
        self.steps += 1
        self.person_steps += turn.is_intervention
        for name in (name for name, met in self.subtasks.items() if met):
            self.marks.setdefault(name, self.steps)

    def share_held(self) -> float:
        """Return the share in [0, 1], of the time for which success must hold until it is believed, it has held."""
        task_s, dt = self._env.scenario.task.dwell_s, self._env.spec.control_dt_s
        held_s = task_s * float(self._env.dwell[0]) + dt * min(self._held, SUCCESS_TICKS)
        return round(held_s / (task_s + SUCCESS_TICKS * dt), 3)

    def shares(self) -> dict[str, float]:
        """Return sub-task -> share of the episode after which it was first solved."""
        return {name: round(step / max(1, self.steps), 4) for name, step in self.marks.items()}
