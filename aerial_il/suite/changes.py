"""What has changed since something was recorded or trained: the meaning of its tier, or the engine."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from aerial_il.core.errors import AerialError
from aerial_il.core.specs import EnvSpec
from aerial_il.suite.engine import ENGINE
from aerial_il.suite.scenario import Scenario


def tier_note(spec: EnvSpec) -> str:
    """Return how the tier of a specification of before differs from the tier of that name today, empty if it does not.

    Environments from outside have no tier of ours.
    """
    if spec.is_outside:
        return ""
    try:
        one_task = spec.task.partition("+")[0]  # of a policy for several
        today = Scenario(spec.robot, one_task, spec.tier).disturbances
    except AerialError as error:
        return f"Its tier {spec.tier} cannot be made today ({error})."
    differing = disturbance_changes(spec.disturbances, today)
    return f"Tier {spec.tier} has changed its meaning since: {'; '.join(differing)}." if differing else ""


def disturbance_changes(before: Mapping[str, Any], today: Mapping[str, Any]) -> list[str]:
    """Name every component of a tier that came, went or changed between two records of its disturbances."""
    old, new = (json.loads(json.dumps(dict(each))) for each in (before, today))
    names = [name for name in {**old, **new} if old.get(name) != new.get(name)]
    return [f"{name} was {_shown(old.get(name))}, is {_shown(new.get(name))}" for name in names]


def engine_note(recorded: str) -> str:
    """Return a sentence where ``recorded`` is not the version of the engine of today, else nothing."""
    if recorded == ENGINE:
        return ""
    return f"It was flown with version {recorded} of the engine, today's is {ENGINE}: physics differ a little."


def _shown(component: Any) -> str:
    return "absent" if component is None else json.dumps(component)
