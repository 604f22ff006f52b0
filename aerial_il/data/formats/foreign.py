"""Demonstrations that others recorded: what their files do not tell is left empty, and named as unknown."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aerial_il.core.specs import NO_CONTROLLER, UNKNOWN, ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode

MARGIN = 1e-6  # of the bounds around the actions that were seen; an action that never varies has bounds, too


def foreign_spec(
    obs: Mapping[str, np.ndarray],
    bounds: tuple[np.ndarray, np.ndarray],
    *,
    max_steps: int,
    control_dt_s: float = 1.0,
    robot: str = UNKNOWN,
    task: str = UNKNOWN,
    state_size: int = 0,
) -> EnvSpec:
    """Return the specification of a dataset that brings none, the same for all of its episodes.

    Args:
        obs: field -> (T, ...) of any episode; (T, H, W, C) uint8 are images.
        bounds: least and greatest action (Da,) of the whole dataset.
        max_steps: of its longest episode. control_dt_s: 1 where nobody tells.
        robot, task: ``gymnasium`` and an id, where the file names such an environment.
    """
    low, high = bounds
    labels = tuple(f"a{i}" for i in range(len(low)))
    return EnvSpec(
        robot=robot,
        task=task,
        tier=UNKNOWN,
        observation=ObservationSpec(tuple(_field(name, values) for name, values in obs.items())),
        action=ActionSpec(UNKNOWN, labels, ("",) * len(labels), low - MARGIN, high + MARGIN),
        control_dt_s=control_dt_s,
        max_steps=max_steps,
        instruction="",
        subtasks=(),
        state_size=state_size,
        controller=NO_CONTROLLER,
    )


def foreign_episode(
    uid: str,
    spec: EnvSpec,
    *,
    obs: Mapping[str, np.ndarray],
    actions: np.ndarray,
    rewards: np.ndarray | None = None,
    states: np.ndarray | None = None,
    success: bool = True,
    terminated: bool = False,
    truncated: bool = False,
    model_xml: str = "",
    source: str,
) -> Episode:
    """Return an episode of T actions.

    Args:
        uid: its name. obs: field -> (T + 1, ...). actions: (T, Da). rewards: (T,), zero where there are none.
        states: (T + 1, S) of a simulator. success: what nobody says to have failed was meant to be imitated.
        terminated, truncated: how it ended. model_xml: scene. source: where it was read, for its provenance.
    """
    steps = len(actions)
    none, last = np.zeros(steps, bool), np.arange(steps) == steps - 1
    return Episode(
        uid=uid,
        spec=spec,
        provenance={"policy": UNKNOWN, "note": f"read from {source}"},
        obs={name: np.asarray(values) for name, values in obs.items()},
        actions=actions,
        executed_actions=actions,
        expert_actions=np.full_like(actions, np.nan),
        is_intervention=none,
        phase=np.full(steps, -1),
        rewards=np.zeros(steps) if rewards is None else np.asarray(rewards, float),
        terminated=last & terminated,
        truncated=last & truncated,
        states=np.zeros((steps + 1, 0)) if states is None else states,
        ctrl=np.zeros((steps, 0)),
        sim_time=np.arange(steps + 1) * spec.control_dt_s,
        success=success,
        model_xml=model_xml,
    )


def _field(name: str, values: np.ndarray) -> Field:
    pictured = values.dtype == np.uint8 and values.ndim == 4
    return Field(name, values.shape[1:] or (1,), "image" if pictured else "proprio", str(values.dtype))
