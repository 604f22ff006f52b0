"""Track: follow a target that moves along an ellipse or a figure eight, for a whole lap.

The path is ``c + w cos(φ) u + h sin(k φ) v`` with k = 1 (ellipse) or 2 (figure eight, a Lissajous curve) in a plane of
random orientation, the angle φ running at a constant rate. The target never waits: the tool catches up with it, and a
lap begins wherever it does. Losing the target breaks the lap off, and another may begin while time remains.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, cosine_and_sine, length
from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.props.marker import add_marker
from aerial_il.suite.scene import CONTROL_DT_S
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

RMSE_M, LOST_M = 0.03, 0.08  # root mean square and largest distance of the tool from the target over a lap
CAUGHT_M = 0.03  # a lap begins once the tool is this close
CENTRE_LOW, CENTRE_HIGH = np.array([-0.25, -0.25, 0.75]), np.array([0.25, 0.25, 0.95])
HALF_WIDTH_M, HALF_HEIGHT_M = (0.20, 0.35), (0.08, 0.15)
SPEED_M_S = (0.15, 0.30)  # the largest along the path
PREVIEW_S = (0.2, 0.5)
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.2]), np.array([0.3, 0.3, 1.35])

PHASE, RATE, WIDTH, HEIGHT, HARMONIC, LAP, SQUARES = range(7)  # places in the episode's memory
FULL_LAP = 2.0 * math.pi


class Track(Task):
    """One full lap within 3 cm root mean square and never beyond 8 cm of the target, at whatever tool orientation.

    The tool is still within 8 cm when the lap is complete, for five control steps.
    """

    name = "track"
    grade = "easy"
    instruction = "Follow the moving green ball closely for one full lap."
    time_limit_s = 45.0
    dwell_s = 0.1
    subtasks = ("within_10_cm", "on_target", "quarter_lap", "half_lap", "full_lap")

    needs_arm = False

    def obstacle_to(self, robot: Robot) -> str | None:
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_marker(spec, tolerance=RMSE_M)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        memory, target = view.memory[world], view.mocap_id("target")
        harmonic, width, height = rng.integers(1, 3), rng.uniform(*HALF_WIDTH_M), rng.uniform(*HALF_HEIGHT_M)
        fastest = max(width, height) if harmonic == 1 else math.hypot(width, 2.0 * height)
        phase, direction = rng.uniform(0.0, FULL_LAP), rng.choice([-1.0, 1.0])
        memory[PHASE], memory[RATE] = phase, direction * rng.uniform(*SPEED_M_S) / fastest
        memory[WIDTH], memory[HEIGHT], memory[HARMONIC] = width, height, harmonic
        yaw, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 0.5 * np.pi)
        c, s, ct, st = math.cos(yaw), math.sin(yaw), math.cos(tilt), math.sin(tilt)
        across, along = np.array([c, s, 0.0]), np.array([-s * ct, c * ct, st])
        offset = width * math.cos(phase) * across + height * math.sin(harmonic * phase) * along
        view.mocap_pos[world, target] = rng.uniform(CENTRE_LOW, CENTRE_HIGH) + offset
        c, s, ct, st = math.cos(0.5 * yaw), math.sin(0.5 * yaw), math.cos(0.5 * tilt), math.sin(0.5 * tilt)
        view.mocap_quat[world, target] = [c * ct, c * st, s * st, s * ct]  # yaw, then tilt about the path's width

    def remember(self, view: View, mask: np.ndarray) -> None:
        axes, target = view.site_mat("target"), view.mocap_id("target")
        _follow(view.memory, axes, view.mocap_pos[:, target], view.tool_pos, mask)

    def fields(self) -> tuple[Field, ...]:
        xyz = ("x", "y", "z")
        soon, later = (tuple(f"{axis}_in_{seconds}_s" for axis in xyz) for seconds in PREVIEW_S)
        return (
            Field("target_pos", (3,), "task", unit="m", labels=xyz),
            Field("target_vel", (3,), "task", unit="m/s", labels=xyz),
            Field("tool_to_target", (3,), "task", unit="m", labels=xyz),
            Field("tool_to_preview", (6,), "task", unit="m", labels=(*soon, *later)),
            Field("lap", (4,), "task", labels=("cos_phase", "sin_phase", "done", "rmse_of_allowed")),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        target, tool = target_pos(view), view.tool_pos
        phase = cosine_and_sine(view.memory[:, PHASE])
        return {
            "target_pos": target,
            "target_vel": (target_ahead(view, CONTROL_DT_S) - target) / CONTROL_DT_S,
            "tool_to_target": target - tool,
            "tool_to_preview": np.concatenate([target_ahead(view, seconds) - tool for seconds in PREVIEW_S], axis=1),
            "lap": np.stack([*phase, _lap_share(view), lap_rmse(view) / RMSE_M], axis=1),
        }

    def solved(self, view: View) -> np.ndarray:
        complete = (view.memory[:, LAP] >= FULL_LAP) & (lap_rmse(view) <= RMSE_M)
        there = length(target_pos(view) - view.tool_pos) <= LOST_M
        return complete & there & (view.unwanted_contacts == 0)

    def progress(self, view: View) -> np.ndarray:
        distance, share = length(target_pos(view) - view.tool_pos), _lap_share(view)
        parts = [share >= part for part in (0.25, 0.5, 1.0)]
        return np.stack([distance <= 0.1, distance <= CAUGHT_M, *parts], axis=1)

    def reward(self, view: View) -> np.ndarray:
        distance = length(target_pos(view) - view.tool_pos)
        following = 0.5 * closeness(distance, 0.3) + 0.5 * closeness(distance, CAUGHT_M)
        return following * (0.5 + 0.5 * _lap_share(view))


def target_pos(view: View) -> np.ndarray:
    """(n, 3) where the target is now, world, m; its site is drawn where it was one control step ago."""
    return view.mocap_pos[:, view.mocap_id("target")].copy()


def target_ahead(view: View, seconds: float) -> np.ndarray:
    """(n, 3) where the target will be in ``seconds``, world, m."""
    pos = target_pos(view)
    _move_on(view.memory, view.site_mat("target"), seconds, pos)
    return pos


@kernel
def _move_on(memory, axes, seconds, pos):
    """Add to positions (n, 3) how far targets move along their paths in ``seconds``."""
    for i in range(pos.shape[0]):
        _move(memory, axes, seconds, pos, i)


@kernel
def _move(memory, axes, seconds, pos, i):
    now, harmonic = memory[i, PHASE], memory[i, HARMONIC]
    then = now + seconds * memory[i, RATE]
    across = memory[i, WIDTH] * (math.cos(then) - math.cos(now))
    along = memory[i, HEIGHT] * (math.sin(harmonic * then) - math.sin(harmonic * now))
    for k in range(3):
        pos[i, k] += across * axes[i, 3 * k]
        pos[i, k] += along * axes[i, 3 * k + 1]


@kernel
def _follow(memory, axes, target, tool, moving):
    """Move targets (n, 3) on by a control step; count for how long, and how closely, tools (n, 3) have followed."""
    for i in range(moving.size):
        if not moving[i]:
            continue
        _move(memory, axes, CONTROL_DT_S, target, i)
        memory[i, PHASE] += CONTROL_DT_S * memory[i, RATE]
        x, y, z = target[i, 0] - tool[i, 0], target[i, 1] - tool[i, 1], target[i, 2] - tool[i, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        close = distance <= (LOST_M if memory[i, LAP] > 0.0 else CAUGHT_M)
        failed = memory[i, LAP] >= FULL_LAP and _rmse(memory, i) > RMSE_M
        if failed or not close:
            memory[i, LAP] = memory[i, SQUARES] = 0.0
        else:
            memory[i, LAP] += CONTROL_DT_S * abs(memory[i, RATE])
            memory[i, SQUARES] += distance * distance


@kernel
def _rmse(memory, i):
    steps = memory[i, LAP] / max(CONTROL_DT_S * abs(memory[i, RATE]), 1e-9)
    return math.sqrt(memory[i, SQUARES] / max(steps, 1.0))


def lap_rmse(view: View) -> np.ndarray:
    """(n,) root mean square distance of the tool from the target since the lap began, m; 0 before."""
    found = np.empty(view.n)
    _rmse_of_all(view.memory, found)
    return found


@kernel
def _rmse_of_all(memory, found):
    for i in range(found.size):
        found[i] = _rmse(memory, i)


def _lap_share(view: View) -> np.ndarray:
    """(n,) how much of a lap has been followed without a break, from 0 to 1."""
    return np.minimum(view.memory[:, LAP] / FULL_LAP, 1.0)


TASK = Track()
