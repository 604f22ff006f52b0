"""The identity of a LeRobot dataset of ours, stored where lerobot's own tools preserve it.

They drop files that they do not know, and keep the description of every feature: the specification stands there, as the
``names`` of the feature ``demo.uid``. What may differ between datasets that are merged is left out: the tier.
"""

import json
from collections.abc import Mapping
from typing import Any

from aerial_il.core.bounded import parse_json
from aerial_il.core.specs import UNKNOWN, EnvSpec

UID = "demo.uid"
OF_ONE_FLIGHT = {"tier": UNKNOWN, "disturbances": {}}


def identity(spec: EnvSpec) -> list[str]:
    """Return the names of the feature ``demo.uid`` that tell ``spec``, equal for all tiers."""
    return [json.dumps({**spec.to_dict(), **OF_ONE_FLIGHT}, sort_keys=True)]


def declared_spec(features: Mapping[str, Any]) -> EnvSpec | None:
    """Return the specification that a dataset's features declare, or None for one of somebody else's.

    Raises:
        ValueError, AerialError: what stands there is no specification.
    """
    names = (features.get(UID) or {}).get("names")
    return EnvSpec.from_dict(parse_json(names[0])) if names else None


def distinct(uids: Mapping[str, Any], uid: str) -> str:
    """Return ``uid``, or where it is taken, as after a merge of overlapping datasets, with the first free number."""
    number, name = 1, uid
    while name in uids:
        number += 1
        name = f"{uid}#{number}"
    return name
