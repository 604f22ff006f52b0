"""What the robots' cameras see of what is handled: shares of the experts' flights, and pixels, by geometry alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import mujoco
import numpy as np

import aerial_il
from aerial_il import robots
from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.parts.camera import Camera, frame_of
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.rendering import View
from experiments.common.report import Report, Row, bar

NEAR_M = 0.2  # of the tool: what is there is being handled
NOTES = (
    "In view: the middle of an object, a named site of the task, is within the frame; what hides it does not count. At "
    "the start: in the first step of a flight. Handling: in the steps in which the tool is within 20 cm of it.",
    "Pixels: median width, in an image of 64 x 64, of a cube as large as the part of the object that is nearest to the "
    "site, in the steps in which it is in view.",
    "Means over the objects of a task; the experts' flights of the named seeds, in calm air, without noise.",
)


class Moments(NamedTuple):
    """Some steps of a cell's flights.

    Attributes:
        frames: of ``base`` and ``tool``: positions (k, 3) m and rotations (k, 3, 3), world from body.
        tool: (k, 3) m. objects: (k, s, 3) m. sizes: (s,) m, edges. first: (k,) bool, steps in which flights begin.
    """

    frames: dict[str, tuple[np.ndarray, np.ndarray]]
    tool: np.ndarray
    objects: np.ndarray
    sizes: np.ndarray
    first: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Cameras:
    """Settings.

    Attributes:
        robots, tasks: which cells; none for all. fov: of each camera, degrees, instead of its own; none for its own.
        episodes: flights of each cell. seed: of the first. every: control steps from one that counts to the next.
        pixels: side of an image. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "cameras"
    question: ClassVar[str] = "How much of what they handle do robots see, and how large?"

    robots: tuple[str, ...] = ("fa_hexa_arm4", "ua_quad_arm4", "big_four_z1", "floating_gripper")
    tasks: tuple[str, ...] = ("reach", "press_button", "pick_place", "open_door", "insert_peg", "rotate_valve")
    fov: tuple[float, ...] = ()
    episodes: int = 16
    seed: int = 20_000
    every: int = 5
    pixels: int = 64
    threads: int = 0

    def __post_init__(self) -> None:
        if min(self.episodes, self.every, self.pixels) < 1:
            raise InvalidValueError("cameras needs episodes, every and pixels of at least 1.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly the experts, and look; see :class:`Study`."""
        started = time.perf_counter()
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        rows = [row for cell in bar(cells, self.name, progress) for row in self.rows_of(*cell)]
        return Report(
            study=self,
            targets=(),
            tables={"By robot": list(means(rows)), "By task": rows},
            notes=NOTES,
            wall_time_s=time.perf_counter() - started,
        )

    def rows_of(self, robot: str, task: str) -> Iterator[Row]:
        """Yield what each camera of a robot sees in a task whose objects have names."""
        with closing(aerial_il.load_batch(robot, task, num_envs=self.episodes, num_threads=self.threads)) as env:
            moments = flown(env, range(self.seed, self.seed + self.episodes), self.every)
        if moments is None:
            return
        for camera in robots.get(robot).mounted_cameras:
            for fov in self.fov or (camera.fov,):
                seen = seen_by(replace(camera, fov=fov), moments, self.pixels)
                yield {"robot": robot, "task": task, "camera": camera.name, "fov": round(fov), **seen}


def flown(env: BatchEnvironment, seeds: range, every: int) -> Moments | None:
    """Return moments of the expert's flights; None where the task names no object."""
    names = [name for name in env.scenario.task.names.sites if name != "tool"]
    if not names:
        return None
    expert, view, model = aerial_il.expert(env.spec.robot, env.spec.task, noise=0.0), env.simulation.view, env.model
    sites = [view.model.site(name).id for name in names]
    offset = np.array(env.scenario.robot.tool_offset)
    expert.attach(env)
    obs, flying, found = env.reset(np.array(seeds)), np.ones(env.num_envs, bool), []
    for step in range(env.spec.max_steps):
        if step % every == 0:
            mat = view.tool_mat.reshape(-1, 3, 3)
            tool = view.tool_pos - mat @ offset, mat
            base = view.base_pos, view.base_mat.reshape(-1, 3, 3)
            now = (*tool, *base, view.tool_pos, view.worlds.bind("site_xpos").reshape(env.num_envs, -1, 3)[:, sites])
            found.append([*(values[flying].copy() for values in now), np.full(flying.sum(), step == 0)])
        result = env.step(expert.act(obs), flying)
        obs, flying = result.obs, flying & ~(result.info["success"] | result.terminated | result.truncated)
        if not flying.any():
            break
    tool_pos, tool_mat, base_pos, base_mat, tool, objects, first = map(np.concatenate, zip(*found, strict=True))
    frames = {"tool": (tool_pos, tool_mat), "base": (base_pos, base_mat)}
    return Moments(frames, tool, objects, np.array([edge_of(model, name) for name in names]), first)


def edge_of(model: mujoco.MjModel, name: str) -> float:
    """Return the edge, m, of a cube as large as the geom of a site's body that is nearest to it."""
    site = model.site(name)
    geoms = np.flatnonzero(model.geom_bodyid == site.bodyid)
    if not len(geoms):
        return 0.0
    nearest = geoms[np.argmin(np.linalg.norm(model.geom_pos[geoms] - site.pos, axis=1))]
    return 2.0 / np.sqrt(3.0) * float(model.geom_rbound[nearest])


def seen_by(camera: Camera, moments: Moments, pixels: int) -> Row:
    """Return shares, %, of moments in which a camera has the objects in its frame, and their pixels."""
    (pos, mat), (place, turn) = moments.frames[camera.on], frame_of(camera)
    tall = float(np.tan(0.5 * np.radians(camera.fov)))
    local = np.einsum("kji,ksj->ksi", mat, moments.objects - pos[:, None])
    seen = View(place, turn, tall, tall).of_balls(local.reshape(-1, 3), np.zeros(local[..., 0].size))
    seen = seen.reshape(local.shape[:2])
    depth = -((local - place) @ turn)[..., 2]
    handled = np.linalg.norm(moments.objects - moments.tool[:, None], axis=2) < NEAR_M
    across = 0.5 * pixels * moments.sizes / tall / np.where(seen, depth, np.nan)
    return {
        "start": _percent(seen[moments.first].mean()),
        "handling": _percent(seen[handled].mean() if handled.any() else np.nan),
        "pixels": round(float(np.nanmedian(across[:, moments.sizes > 0.0])), 1) if seen.any() else None,
    }


def means(rows: list[Row]) -> Iterator[Row]:
    """Yield the mean of each camera over tasks."""
    for key in dict.fromkeys((row["robot"], row["camera"], row["fov"]) for row in rows):
        mine = [row for row in rows if (row["robot"], row["camera"], row["fov"]) == key]
        found = {
            name: round(float(np.mean([r[name] for r in mine if r[name] is not None])), 1)
            for name in ("start", "handling", "pixels")
        }
        yield {"robot": key[0], "camera": key[1], "fov": key[2], "tasks": len(mine), **found}


def _percent(share: float) -> float | None:
    return None if np.isnan(share) else round(100.0 * float(share), 1)
