"""Gymnasium's two-joint arm that reaches for a point: a script that can do it, and the same arm seen by a camera.

``env=gymnasium:experiments.foreign.arm:ReacherPictures-v0`` names the latter; a wrapper of nobody's package, as people
write them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

VECTOR, PICTURES = "Reacher-v5", "experiments.foreign.arm:ReacherPictures-v0"
PERIOD_S = 0.02
LINKS_M = (0.1, 0.11)
STIFFNESS, DAMPING = 0.2, 0.05  # of the script, in commands per rad and per rad/s
JOINTS = np.r_[:4, 6:8]  # of the observation: cosines, sines and rates; without the target and the way to it
SIZE = 84
FROM_ABOVE = {"distance": 0.62, "elevation": -90.0, "trackbodyid": -1, "lookat": np.zeros(3)}


@dataclass(frozen=True, eq=False)
class Flown:
    """An episode of T steps as a script writes it down.

    Attributes:
        obs: field -> (T + 1, ...). actions: (T, 2). rewards, terminated, truncated: (T,).
    """

    obs: Mapping[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


def reach(obs: np.ndarray) -> np.ndarray:
    """Return commands (n, 2) for observations (n, 10): to the joint angles at which the finger is at the target."""
    cosines, sines, target, rates = obs[:, 0:2], obs[:, 2:4], obs[:, 4:6], obs[:, 6:8]
    upper, lower = LINKS_M
    bend = (np.square(target).sum(1) - upper**2 - lower**2) / (2 * upper * lower)
    elbow = np.arccos(np.clip(bend, -1.0, 1.0))
    shoulder = np.arctan2(target[:, 1], target[:, 0]) - np.arctan2(lower * np.sin(elbow), upper + lower * np.cos(elbow))
    left = np.stack([shoulder, elbow], 1) - np.arctan2(sines, cosines)
    left[:, 0] = np.remainder(left[:, 0] + np.pi, 2 * np.pi) - np.pi
    return np.clip(STIFFNESS * left - DAMPING * rates, -1.0, 1.0)


def pilot() -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
    """Return what ``policy=experiments.foreign.arm:pilot`` flies."""
    return lambda obs: reach(np.asarray(obs["observation"]))


def flown(seeds: Iterable[int], *, pictures: bool = False) -> Iterator[Flown]:
    """Yield what a plain loop over the environment records, of the script, one episode for each seed."""
    env = gymnasium.make(PICTURES if pictures else VECTOR)
    for seed in seeds:
        seen, over, rows = [env.reset(seed=seed)[0]], False, []
        while not over:
            action = reach(np.asarray(env.unwrapped._get_obs())[None])[0].astype(np.float32)  # type: ignore[attr-defined]
            after, reward, terminated, truncated, _ = env.step(action)
            rows.append((action, reward, terminated, truncated))
            seen.append(after)
            over = terminated or truncated
        columns = [np.array(column) for column in zip(*rows, strict=True)]
        yield Flown(_by_field(seen), *columns)
    env.close()


def _by_field(seen: list[Any]) -> dict[str, np.ndarray]:
    if isinstance(seen[0], Mapping):
        return {name: np.stack([each[name] for each in seen]) for name in seen[0]}
    return {"observation": np.stack(seen)}


class ReacherPictures(gymnasium.ObservationWrapper):
    """The arm's joints, and a picture from above that alone shows the target."""

    def __init__(self, **settings: Any) -> None:
        camera = {"render_mode": "rgb_array", "width": SIZE, "height": SIZE, "default_camera_config": FROM_ABOVE}
        super().__init__(gymnasium.make(VECTOR, **{**settings, **camera}))
        box = gymnasium.spaces.Box
        self.observation_space = gymnasium.spaces.Dict(
            joints=box(-np.inf, np.inf, (len(JOINTS),)), agentview_image=box(0, 255, (SIZE, SIZE, 3), np.uint8)
        )

    def observation(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        return {"joints": observation[JOINTS].astype(np.float32), "agentview_image": np.asarray(self.env.render())}


gymnasium.register("ReacherPictures-v0", entry_point=ReacherPictures, max_episode_steps=50)
