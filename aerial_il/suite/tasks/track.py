"""Track: follow a target that moves along an ellipse or a figure eight, for a whole lap.

The path is ``c + w cos(φ) u + h sin(k φ) v`` with k = 1 (ellipse) or 2 (figure eight, a Lissajous curve) in a plane of
random orientation, the angle φ running at a constant rate. The target never waits: the tool catches up with it, and a
lap begins wherever it does. Losing the target breaks the lap off, and another may begin while time remains.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, closeness, column, norm, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, mocap_pos, site_mat, task_state, tool_pos, untouched
from aerial_il.suite.props.marker import add_marker
from aerial_il.suite.tasks.fields import EXACT, GIVEN, OWN, XYZ, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start
from aerial_il.suite.timing import CONTROL_DT_S

RMSE_M, LOST_M = 0.03, 0.08  # root mean square and largest distance of the tool from the target over a lap
CAUGHT_M = 0.03  # a lap begins once the tool is this close
CENTRE_LOW, CENTRE_HIGH = np.array([-0.25, -0.25, 0.75]), np.array([0.25, 0.25, 0.95])
HALF_WIDTH_M, HALF_HEIGHT_M = (0.20, 0.35), (0.08, 0.15)
SPEED_M_S = (0.15, 0.30)  # the largest along the path
PREVIEW_S = (0.2, 0.5)
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.2]), np.array([0.3, 0.3, 1.35])

PHASE, RATE, WIDTH, HEIGHT, HARMONIC, LAP, SQUARES = range(7)  # places in the episode's state
FULL_LAP = 2.0 * math.pi
TARGET = 0  # site and mocap body


class Track(Task):
    """One full lap within 3 cm root mean square and never beyond 8 cm of the target, with any tool orientation.

    The tool is still within 8 cm when the lap is complete, for five control steps.
    """

    name = "track"
    grade = "easy"
    instruction = "Follow the moving green ball closely for one full lap."
    wordings = (
        "Follow the green ball with the gripper.",
        "Stay close to the moving ball for one lap.",
        "跟着移动的绿球走完一圈。",
        "紧跟绿球。",
    )
    held_out = ("Keep the gripper at the moving green ball.", "请跟踪绿色的球。")
    time_limit_s = 45.0
    dwell_s = 0.1
    subtasks = ("within_10_cm", "on_target", "quarter_lap", "half_lap", "full_lap")
    names = Names(sites=("target",), mocaps=("target",))
    commanded = ("target",)
    privileged = (
        ("lap", "`done` and `rmse_of_allowed` come from the success check, which uses the true tool position"),
    )

    needs_arm = False

    def own_infeasibility(self, robot: Robot) -> str | None:
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_marker(spec, tolerance=RMSE_M)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        state, target = view.task_state[world], view.mocap_id("target")
        harmonic, width, height = rng.integers(1, 3), rng.uniform(*HALF_WIDTH_M), rng.uniform(*HALF_HEIGHT_M)
        fastest = max(width, height) if harmonic == 1 else math.hypot(width, 2.0 * height)
        phase, direction = rng.uniform(0.0, FULL_LAP), rng.choice([-1.0, 1.0])
        state[PHASE], state[RATE] = phase, direction * rng.uniform(*SPEED_M_S) / fastest
        state[WIDTH], state[HEIGHT], state[HARMONIC] = width, height, harmonic
        yaw, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 0.5 * np.pi)
        c, s, ct, st = math.cos(yaw), math.sin(yaw), math.cos(tilt), math.sin(tilt)
        across, along = np.array([c, s, 0.0]), np.array([-s * ct, c * ct, st])
        offset = width * math.cos(phase) * across + height * math.sin(harmonic * phase) * along
        view.mocap_pos[world, target] = rng.uniform(CENTRE_LOW, CENTRE_HIGH) + offset
        c, s, ct, st = math.cos(0.5 * yaw), math.sin(0.5 * yaw), math.cos(0.5 * tilt), math.sin(0.5 * tilt)
        view.mocap_quat[world, target] = [c * ct, c * st, s * st, s * ct]  # yaw, then tilt about the path's width

    def fields(self) -> tuple[Field, ...]:
        lap = ("cos_phase", "sin_phase", "done", "rmse_of_allowed")
        soon, later = (tuple(f"{axis}_in_{seconds}_s" for axis in XYZ) for seconds in PREVIEW_S)
        return (
            seen("target_pos", "the ball", noise=GIVEN),
            seen("target_vel", "velocity of the ball", unit="m/s", noise=GIVEN),
            seen("tool_to_target", "from the tool to the ball", noise=OWN),
            seen("tool_to_preview", "to where it will be in 0.2 and in 0.5 s", 6, labels=(*soon, *later), noise=OWN),
            seen("lap", "how far the tool has come", 4, unit="", frame="", labels=lap, noise=EXACT, real=False),
        )


@kernel
def observe(world, found):
    target, tool, state = target_pos(world), tool_pos(world), task_state(world)
    put(found, 0, target)
    put(found, 3, scale(1.0 / CONTROL_DT_S, sub(target_ahead(world, CONTROL_DT_S), target)))
    put(found, 6, sub(target, tool))
    put(found, 9, sub(target_ahead(world, PREVIEW_S[0]), tool))
    put(found, 12, sub(target_ahead(world, PREVIEW_S[1]), tool))
    found[15], found[16] = math.cos(state[PHASE]), math.sin(state[PHASE])
    found[17], found[18] = lap_share(world), lap_rmse(world) / RMSE_M


@kernel
def remember(world):
    """Move the target on by a control step; count for how long, and how closely, the tool has followed."""
    state = task_state(world)
    put(mocap_pos(world, TARGET), 0, target_ahead(world, CONTROL_DT_S))
    state[PHASE] += CONTROL_DT_S * state[RATE]
    distance = norm(sub(target_pos(world), tool_pos(world)))
    close = distance <= (LOST_M if state[LAP] > 0.0 else CAUGHT_M)
    failed = state[LAP] >= FULL_LAP and lap_rmse(world) > RMSE_M
    if failed or not close:
        state[LAP] = state[SQUARES] = 0.0
    else:
        state[LAP] += CONTROL_DT_S * abs(state[RATE])
        state[SQUARES] += distance * distance


@kernel
def solved(world):
    complete = task_state(world)[LAP] >= FULL_LAP and lap_rmse(world) <= RMSE_M
    there = norm(sub(target_pos(world), tool_pos(world))) <= LOST_M
    return complete and there and untouched(world)


@kernel
def progress(world, flags):
    distance, share = norm(sub(target_pos(world), tool_pos(world))), lap_share(world)
    flags[0], flags[1] = distance <= 0.1, distance <= CAUGHT_M
    flags[2], flags[3], flags[4] = share >= 0.25, share >= 0.5, share >= 1.0


@kernel
def reward(world):
    distance = norm(sub(target_pos(world), tool_pos(world)))
    following = 0.5 * closeness(distance, 0.3) + 0.5 * closeness(distance, CAUGHT_M)
    return following * (0.5 + 0.5 * lap_share(world))


@kernel
def target_pos(world):
    """Position of the target now, world frame, m; its site is drawn where it was one control step ago."""
    return vec(mocap_pos(world, TARGET), 0)


@kernel
def target_ahead(world, seconds):
    """Position of the target in ``seconds``, world frame, m."""
    state, axes = task_state(world), site_mat(world, TARGET)
    now, harmonic = state[PHASE], state[HARMONIC]
    then = now + seconds * state[RATE]
    across = state[WIDTH] * (math.cos(then) - math.cos(now))
    along = state[HEIGHT] * (math.sin(harmonic * then) - math.sin(harmonic * now))
    return add(target_pos(world), add(scale(across, column(axes, 0)), scale(along, column(axes, 1))))


@kernel
def lap_rmse(world):
    """Root mean square distance of the tool from the target since the lap began, m; 0 before."""
    state = task_state(world)
    steps = state[LAP] / max(CONTROL_DT_S * abs(state[RATE]), 1e-9)
    return math.sqrt(state[SQUARES] / max(steps, 1.0))


@kernel
def lap_share(world):
    """Share of a lap that has been followed without a break, from 0 to 1."""
    return min(task_state(world)[LAP] / FULL_LAP, 1.0)


TASK = Track(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember))
