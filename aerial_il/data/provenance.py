"""Names and origins of episodes: what a flight depends on, and nothing that changes when it is flown again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import mujoco

from aerial_il.core.provenance import provenance
from aerial_il.core.specs import EnvSpec

RNG = "PCG64(SeedSequence(sha256('robot/task/purpose'), seed))"
DROPPED = "dropped"  # the note of a flight that ended because its object was out of reach for good
STATE = "mjSTATE_INTEGRATION, then the environment's own memory; float64"


def episode_uid(spec: EnvSpec, *, seed: int, policy: str, settings: Mapping[str, Any]) -> str:
    """Return the name of the episode that ``policy`` flies with ``seed``.

    It ends in a digest of the specification, the policy and its settings, so that datasets can be merged and a
    collection knows what it has flown already.
    """
    origin = json.dumps([spec.to_dict(), policy, settings], sort_keys=True)
    digest = hashlib.sha256(origin.encode()).hexdigest()[:8]
    return f"{spec.robot}-{spec.task}-{spec.tier}-{seed:06d}-{digest}".replace("/", "_")


def episode_provenance(
    spec: EnvSpec,
    *,
    seed: int,
    policy: str,
    settings: Mapping[str, Any],
    model_xml: str,
    phases: tuple[str, ...] = (),
    drawn: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return where an episode comes from, as JSON values; equal for equal flights.

    Args:
        spec: the environment.
        seed: the episode's seed.
        policy: who flew: ``expert``, an operator, or a policy's folder.
        settings: whatever else was configured, e.g. the expert's noise.
        model_xml: the compiled scene.
        phases: names of the expert's phases.
        drawn: what the tier's disturbances are in this episode.
    """
    return {
        "robot": spec.robot,
        "task": spec.task,
        "tier": spec.tier,
        "disturbances": dict(spec.disturbances),
        "drawn": dict(drawn or {}),
        "seed": seed,
        "rng": RNG,
        "policy": policy,
        "settings": dict(settings),
        "phases": list(phases),
        "action_level": spec.action.level,
        "controller": spec.controller,
        "control_dt_s": spec.control_dt_s,
        "state": STATE,
        "mujoco": mujoco.__version__,
        "model_sha256": hashlib.sha256(model_xml.encode()).hexdigest(),
        **provenance(),
    }
