"""Names and origins of episodes: what a flight depends on, and nothing that changes when it is flown again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco

from aerial_il.core.provenance import provenance
from aerial_il.core.specs import EnvSpec

RNG = "PCG64(SeedSequence(sha256('robot/task/purpose'), seed))"
STATE = "mjSTATE_INTEGRATION, then the environment's own memory; float64"


@dataclass(frozen=True, eq=False)
class Origin:
    """What the episodes of one collection have in common.

    Attributes:
        spec: the environment.
        policy: who flies: ``expert``, an operator, or a policy's folder.
        settings: whatever else was configured, e.g. the expert's noise.
        model_xml: the compiled scene.
        phases: names of the expert's phases.
    """

    spec: EnvSpec
    policy: str
    settings: Mapping[str, Any]
    model_xml: str
    phases: tuple[str, ...] = ()

    def uid(self, seed: int) -> str:
        """Return the name of the episode that is flown with ``seed``.

        It ends in a digest of the specification, the policy and its settings, so that datasets can be merged and a
        collection knows what it has flown already.
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
        origin = json.dumps([self.spec.to_dict(), self.policy, self.settings], sort_keys=True)
        return hashlib.sha256(origin.encode()).hexdigest()[:8]

    @cached_property
    def _common(self) -> dict[str, Any]:
        spec = self.spec
        return {
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
