"""What a person wants to do next, task by task: a file of :mod:`aerial_il.teleop.driver.plans` each."""

import importlib
import pkgutil
from dataclasses import dataclass
from typing import Protocol

from aerial_il.core.errors import UnknownNameError
from aerial_il.teleop.driver import plans
from aerial_il.teleop.driver.eyes import Sight
from aerial_il.teleop.driver.habit import Habit
from aerial_il.teleop.piloting.command import Vec3


@dataclass(frozen=True)
class Wish:
    """What a person wants at one moment.

    Attributes:
        offset: m, where the tool is to go: ahead, left, up. turn: rad, of the tool: to the left, nose down, right side
            down. grip: 1 closes, -1 opens. mode: of the sticks. fine: with the precision button held.
        part: of the task; a new one begins with a pause. unfinished: nobody would let go of the controls now.
        hopeless: it has failed often enough: the flight is given up.
    """

    part: str
    offset: Vec3 = (0.0, 0.0, 0.0)
    turn: Vec3 = (0.0, 0.0, 0.0)
    grip: int = 0
    mode: str = "tool"
    fine: bool = False
    unfinished: bool = False
    hopeless: bool = False


class Plan(Protocol):
    """How one task is done by hand."""

    def begin(self, sight: Sight, habit: Habit) -> None:
        """Begin, or take over in the midst of it."""
        ...

    def wish(self, sight: Sight) -> Wish:
        """Return what to do next."""
        ...

    def left(self, sight: Sight) -> float:
        """Return about how much is left to do, m of the tool's way: by it one sees whether a flight gets on."""
        ...


def plan_for(task: str) -> Plan:
    """Return the plan of a task.

    Raises:
        UnknownNameError: nobody has written down how a person does it; names the tasks that there are.
    """
    known = sorted(module.name for module in pkgutil.iter_modules(plans.__path__))
    if task not in known:
        raise UnknownNameError("task for the model of a driver", task, known)
    return importlib.import_module(f"{plans.__name__}.{task}").PLAN()
