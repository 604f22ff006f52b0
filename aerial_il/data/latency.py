"""Latency of demonstrations: observations and actions shifted against each other, as if things were less late, or more.

A row of a recording holds what was seen and what was sent at one moment. What was seen is older than that, what was
sent comes later: the row pairs a state of the world with an action for a later one. Shifted by both delays, each state
is paired with what was done in it, and demonstrations with latency teach what those without it teach. Shifted by less,
or the other way, they teach to fly with the latency that is left.

Source: C. Chi et al., "Universal Manipulation Interface", 2024, section IV-B (latency matching).
"""

from dataclasses import replace

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import LONGEST_MS, Latency
from aerial_il.data.episode import Episode

PER_STEP = (
    "actions", "expert_actions", "is_intervention", "phase", "rewards", "terminated", "truncated",
    "ctrl",
)  # fmt: skip


def with_latency(episode: Episode, latency_ms: float) -> Episode:
    """Return the episode as if ``latency_ms`` lay between what is seen and what is done, whatever lay there.

    Observations that would have been seen before the flight are its first one. Where less lies between than did, the
    last actions have no observations of their own: they are left out.

    Args:
        episode: with or without latency of its own, see :meth:`.Latency.of`.
        latency_ms: to the nearest control step; 0 takes all of it out.

    Raises:
        InvalidValueError: the latency is negative or too long, what the episode tells of its own is none, or the
            episode is no longer than what is to be taken out.
    """
    if not 0 <= latency_ms <= LONGEST_MS:
        limits = f"it must lie in [0, {LONGEST_MS:g}]. 0 takes out all latency."
        raise InvalidValueError(f"latency_ms is {latency_ms:g}; {limits}")
    step_ms = 1000 * episode.spec.control_dt_s
    try:
        own_ms = Latency.of(episode.provenance, episode.spec.control_dt_s).total_ms
    except (AttributeError, TypeError, ValueError, InvalidValueError) as error:
        raise InvalidValueError(f"What {episode.uid} tells of its latency cannot be: {error}") from error
    shift, steps = round((own_ms - latency_ms) / step_ms), len(episode)
    if shift == 0:
        return episode
    if shift >= steps:
        raise InvalidValueError(
            f"{episode.uid} lasts {steps * step_ms:g} ms, no longer than its latency, {own_ms:g} ms."
        )
    kept = steps - max(shift, 0)
    seen = np.clip(np.arange(kept + 1) + shift, 0, steps)
    rows = {name: getattr(episode, name)[:kept] for name in PER_STEP}
    rows["executed_actions"] = _executed_when_sent(episode, step_ms)[:kept]
    rows |= {name: getattr(episode, name)[: kept + 1] for name in ("states", "sim_time")}
    extras = {name: values[:kept] for name, values in episode.extras.items()}
    return replace(episode, obs={name: values[seen] for name, values in episode.obs.items()}, extras=extras, **rows)


def _executed_when_sent(episode: Episode, step_ms: float) -> np.ndarray:
    """Return what was executed (T, Da) in the rows in which it was sent; what was not, at the end, as it was sent."""
    late = round(episode.provenance.get("settings", {}).get("action_delay_ms", 0.0) / step_ms)
    return np.concatenate([episode.executed_actions[late:], episode.actions[max(len(episode) - late, 0) :]])
