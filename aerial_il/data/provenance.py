"""Names and origins of episodes: what a flight depends on, and nothing that changes when it is flown again."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

import mujoco

from aerial_il.core.provenance import provenance
from aerial_il.core.specs import EnvSpec

RNG = "PCG64(SeedSequence(sha256('robot/task/purpose'), seed))"
_UID = re.compile(r".*-\d{6,}-([0-9a-f]{8})")
FIRST_ENGINE = "1"  # of recordings of the suite that do not name theirs
STATE = "mjSTATE_INTEGRATION, then the environment's own memory; float64"


def episode_uid(
    spec: EnvSpec, *, seed: int, policy: str, settings: Mapping[str, Any], engine: str | None = None
) -> str:
    """Return the name of the episode that ``policy`` flies with ``seed``.

    It ends in a digest of the specification, the policy, its settings and the engine, so that datasets can be merged
    and a collection knows what it has flown already.
    """
    made = [spec.to_dict(), policy, settings, *([engine] if engine else [])]
    origin = json.dumps(made, sort_keys=True)
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
    engine: str | None = None,
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
        engine: version of the suite's simulation engine; None for an environment from outside.
    """
    return {
        **({"engine": engine} if engine else {}),
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


def made_by(uid: str) -> str:
    """Return the digest by which an episode's name tells how it was made apart from its seed; empty for other names."""
    found = _UID.fullmatch(uid)
    return found[1] if found else ""


def engine_of(provenance: Mapping[str, Any]) -> str:
    """Return the version of the suite's engine that an episode was flown with."""
    return str(provenance.get("engine", FIRST_ENGINE))


def conditions_of(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return how an episode was made apart from its seed: by whom, under what, with what settings and engine."""
    told = {key: provenance.get(key) for key in ("tier", "controller", "policy", "action_level", "disturbances")}
    return told | {"settings": provenance.get("settings", {}), "engine": engine_of(provenance)}
