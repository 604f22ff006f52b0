"""Say what a dataset holds: the environment, its fields, how its episodes were made, and each of them.

Example: aerial-il info datasets/pick
Example: aerial-il info datasets/pick where="not success and phase == 'grasp'"
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import table, wrapped
from aerial_il.data.columns import LABELS, MADE_BY
from aerial_il.workflows.info import Info, info


@dataclass(frozen=True, kw_only=True)
class Shown(AsJson, Info):
    """How it is shown."""


SETTINGS, BARE = Shown, ("path",)


def run(settings: Shown) -> None:
    """Print the description."""
    described = info(settings)
    settings.show(described, lambda: _as_text(described))


def _as_text(described: dict[str, Any]) -> str:
    from aerial_il.core.specs import UNKNOWN

    episodes = described["episodes"]
    won, seconds = sum(e["success"] for e in episodes), sum(e["seconds"] for e in episodes)
    tiers = ", ".join(dict.fromkeys(e["tier"] for e in episodes))
    where = (described["robot"], described["task"], tiers)
    action = f"Action {described['action']['level']}: {', '.join(described['action']['elements'])}"
    total = f"{len(episodes)} episodes, {won} successful, {seconds:.0f} s of flight"
    made_by = [table(described["made_by"])]
    if described["foreign"]:  # which say less
        known = " ".join(name for name in where if name != UNKNOWN)
        where = (f"{described['format']}," if known else described["format"], known)
        total += f": {sum(e['steps'] for e in episodes)} steps at {1 / described['control_dt_s']:g} Hz"
        made_by = []
    hidden = {*MADE_BY, "instruction", *(key for key in LABELS if not any(e[key] for e in episodes))}
    shown = [{key: e[key] for key in e if key not in hidden} for e in episodes]
    notes = [_warning(described["repeated_seeds"])] if described["repeated_seeds"] else []
    head = f"{described['path']}: {' '.join(filter(None, where))}. {described['instruction']}"
    parts = [wrapped(head), wrapped(action), table(described["fields"]), total, *made_by, *notes, table(shown)]
    return "\n\n".join(parts)


def _warning(seeds: Sequence[int]) -> str:
    named = ", ".join(map(str, seeds[:10])) + (", ..." if len(seeds) > 10 else "")
    return f"Warning: {len(seeds)} seeds were flown more than once, so these episodes start alike: {named}."
