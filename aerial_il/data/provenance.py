"""Names and origins of episodes: what a flight depends on, and nothing that changes when it is flown again."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from aerial_il.core.provenance import provenance
from aerial_il.core.specs import EnvSpec

RNG = "PCG64(SeedSequence(sha256('robot/task/purpose'), seed))"
_UID = re.compile(r".*-\d{6,}-([0-9a-f]{8})")
FIRST_ENGINE = "1"  # of recordings of the suite that do not name theirs
HUMAN = "human:"  # before the name of a person who flew, or took over, in an episode's ``policy``
DROPPED = "dropped"  # the note of a flight that ended because its object was out of reach for good
SESSION = "session"  # key of a setting: when a person began to fly, by which flights of two sessions differ in name
INSTRUCTION = "instruction"  # key of an episode's own, where those of a dataset differ
STATE = "mjSTATE_INTEGRATION, then the environment's own memory; float64"


@dataclass(frozen=True, eq=False)
class Origin:
    """The provenance that the episodes of one collection have in common.

    Attributes:
        spec: the environment.
        policy: who flies: ``expert``, an operator, or a policy's folder.
        settings: whatever else was configured, e.g. the expert's noise.
        model_xml: the compiled scene.
        phases: names of the expert's phases.
        engine: version of the suite's simulation engine; None for an environment from outside.
    """

    spec: EnvSpec
    policy: str
    settings: Mapping[str, Any]
    model_xml: str
    phases: tuple[str, ...] = ()
    engine: str | None = None

    def uid(self, seed: int) -> str:
        """Return the name of the episode that is flown with ``seed``.

        It ends in a digest of the specification, the policy, its settings and the engine, so that datasets can be
        merged and a collection knows what it has flown already.
        """
        spec = self.spec
        return f"{spec.robot}-{spec.task}-{spec.tier}-{seed:06d}-{self._digest}".replace("/", "_")

    def provenance(self, seed: int, drawn: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return where an episode comes from, as JSON values; equal for equal flights.

        Args:
            seed: the episode's seed.
            drawn: what the tier's disturbances are in this episode.
        """
        return {**self._common, "drawn": dict(drawn or {}), "seed": seed}

    @cached_property
    def _digest(self) -> str:
        made = [self.spec.to_dict(), self.policy, self.settings, *([self.engine] if self.engine else [])]
        return hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()[:8]

    @cached_property
    def _common(self) -> dict[str, Any]:
        spec = self.spec
        import mujoco  # an exported policy, which imports this file, flies without

        return {
            **({"engine": self.engine} if self.engine else {}),
            "robot": spec.robot,
            "task": spec.task,
            "tier": spec.tier,
            "disturbances": dict(spec.disturbances),
            "drawn": {},
            "seed": -1,
            "rng": RNG,
            "policy": self.policy,
            "settings": dict(self.settings),
            "phases": list(self.phases),
            "action_level": spec.action.level,
            "controller": spec.controller,
            "control_dt_s": spec.control_dt_s,
            "state": STATE,
            "mujoco": mujoco.__version__,
            "model_sha256": hashlib.sha256(self.model_xml.encode()).hexdigest(),
            **provenance(),
        }


def made_by(uid: str) -> str:
    """Return the digest by which an episode's name tells how it was made apart from its seed; empty for other names."""
    found = _UID.fullmatch(uid)
    return found[1] if found else ""


def flown_by_hand(provenance: Mapping[str, Any]) -> bool:
    """Return whether a person flew an episode, or took over in it."""
    return HUMAN in str(provenance.get("policy", ""))


def operator_of(provenance: Mapping[str, Any]) -> str:
    """Return the name of the person who flew an episode, or took over in it; empty where nobody did."""
    return str(provenance.get("policy", "")).partition(HUMAN)[2]


def instruction_of(provenance: Mapping[str, Any], spec: EnvSpec) -> str:
    """Return what was to be done: an episode's own words, where those of a dataset differ, else those of its task."""
    return str(provenance.get(INSTRUCTION) or spec.instruction)


def engine_of(provenance: Mapping[str, Any]) -> str:
    """Return the version of the suite's engine that an episode was flown with."""
    return str(provenance.get("engine", FIRST_ENGINE))


def conditions_of(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return how an episode was made apart from its seed: by whom, under what, with what settings and engine."""
    settings = {key: value for key, value in provenance.get("settings", {}).items() if key != SESSION}
    named = {key: provenance.get(key) for key in ("tier", "controller", "policy", "action_level", "disturbances")}
    return named | {"settings": settings, "engine": engine_of(provenance)}
