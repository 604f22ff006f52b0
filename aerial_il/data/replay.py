"""Fly a recording again and require every state to be equal, bit for bit."""

import os
from collections.abc import Sequence

import mujoco
import numpy as np

from aerial_il.core.contracts import BatchEnv, Pushable, StepResult
from aerial_il.core.errors import DemoError
from aerial_il.data.episode import PERTURBATION, Episode
from aerial_il.data.provenance import engine_of


def replay(env: BatchEnv, episode: Episode, *, starts: Sequence[int] = (0,), path: str | os.PathLike[str] = "") -> int:
    """Simulate the executed actions from recorded states on, and compare every state and outcome that follows.

    Args:
        env: a batch environment like the one that was recorded; world i resumes from the i-th start.
        episode: the recording.
        starts: steps to resume from; any step must do.
        path: the recording's file, for errors.

    Returns:
        The number of simulated steps that were compared.

    Raises:
        DemoError: the first state that differs, or an environment, scene or engine that cannot be compared.
    """
    path = str(path or episode.uid)
    _check_same(env, episode, path)
    compared = 0
    for first in range(0, len(starts), env.num_envs):
        compared += _replay_some(env, episode, np.asarray(starts[first : first + env.num_envs]), path)
    return compared


def check_engine(engine: str | None, episode: Episode, path: str) -> None:
    """Raise :class:`DemoError` if a recording was flown with another version of the suite's engine than ``engine``.

    None stands for an environment that is not the suite's.
    """
    recorded = engine_of(episode.provenance)
    if engine is not None and not episode.spec.is_outside and recorded != engine:
        hint = "Its bits cannot come again. It may still be trained on, converted and viewed."
        raise DemoError(path, "was flown with another version of the engine.", expected=engine, got=recorded, hint=hint)


def _replay_some(env: BatchEnv, episode: Episode, starts: np.ndarray, path: str) -> int:
    """Replay from at most n starts at once, each in its own world."""
    if starts.size and not (starts.min() >= 0 and starts.max() < len(episode)):
        raise DemoError(path, "cannot resume there.", expected=f"steps 0..{len(episode) - 1}", got=starts.tolist())
    current = np.full(env.num_envs, len(episode))
    current[: len(starts)] = starts
    active = current < len(episode)
    env.set_state(episode.states[np.minimum(current, len(episode) - 1)])
    _compare(env, episode, current, active, starts, path)
    compared = 0
    while active.any():
        _push(env, episode, current, active)
        result = env.step(episode.executed_actions[np.minimum(current, len(episode) - 1)], active)
        _compare_outcome(result, episode, current, active, path)
        current[active] += 1
        _compare(env, episode, current, active, starts, path)
        compared += int(active.sum())
        active = current < len(episode)
    return compared


def _push(env: BatchEnv, episode: Episode, current: np.ndarray, active: np.ndarray) -> None:
    """Let happen again what somebody let happen to the base before the coming steps."""
    if PERTURBATION not in episode.extras or not isinstance(env, Pushable):
        return
    velocity = episode.extras[PERTURBATION][np.minimum(current, len(episode) - 1), :3]
    if (pushed := active & velocity.any(axis=1)).any():
        env.push(velocity, pushed)


def _compare(
    env: BatchEnv, episode: Episode, current: np.ndarray, active: np.ndarray, starts: np.ndarray, path: str
) -> None:
    states = env.get_state()
    for world in np.flatnonzero(active):
        step, start = int(current[world]), int(starts[world])
        wrong = np.flatnonzero(states[world] != episode.states[step])
        if wrong.size:
            i = int(wrong[0])
            raise DemoError(
                path,
                f"does not replay: resumed at step {start}, its state differs.",
                topic="/step",
                step=step,
                field=f"state[{i}]",
                expected=repr(episode.states[step, i]),
                got=repr(states[world, i]),
                hint="It was flown with other code or on another machine; see its provenance.",
            )


def _compare_outcome(result: StepResult, episode: Episode, current: np.ndarray, active: np.ndarray, path: str) -> None:
    for name, recorded, got in (
        ("reward", episode.rewards, result.reward),
        ("terminated", episode.terminated, result.terminated),
    ):
        for world in np.flatnonzero(active):
            step = int(current[world])
            if recorded[step] != got[world]:
                raise DemoError(
                    path, "does not replay: an outcome differs.", topic="/step", step=step, field=name,
                    expected=recorded[step], got=got[world],
                )  # fmt: skip


def _check_same(env: BatchEnv, episode: Episode, path: str) -> None:
    if not episode.states.size:
        raise DemoError(path, "holds no simulator states and cannot be replayed.")
    check_engine(env.engine, episode, path)
    if differing := env.spec.differences(episode.spec, ignore=()):
        raise DemoError(path, f"was flown in another environment: {'; '.join(differing[:3])}.")
    recorded = str(episode.provenance.get("mujoco", mujoco.__version__))
    if recorded.split(".")[0] != mujoco.__version__.split(".")[0]:
        raise DemoError(path, "was flown with another MuJoCo.", expected=mujoco.__version__, got=recorded)
    if episode.model_xml != env.model_xml:
        raise DemoError(path, "was flown in another scene: its model differs from the environment's.")
