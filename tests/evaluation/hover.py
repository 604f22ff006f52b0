"""A small real-MuJoCo batch environment with the suite's interface: a carriage that servoes to a goal in the air.

It exists so that evaluation is tested in milliseconds and for outcomes a real task seldom shows on demand:
goals may be out of reach (time-out), and flying below the floor's margin is a crash.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.errors import SimulationDivergedError
from aerial_il.core.seeding import episode_rng
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec

DT_S, SUBSTEPS, DWELL_STEPS, TOLERANCE_M, LEAD_M = 0.02, 5, 10, 0.02, 0.12

SCENE = """
<mujoco model="hover">
  <option timestep="0.004" integrator="implicitfast"/>
  <visual><quality offsamples="0" shadowsize="0"/><headlight ambient=".5 .5 .5" diffuse=".3 .3 .3"/></visual>
  <asset>
    <texture name="floor" type="2d" builtin="checker" rgb1=".86 .88 .9" rgb2=".8 .82 .85" width="64" height="64"/>
    <material name="floor" texture="floor" texrepeat="8 8"/>
    <texture type="skybox" builtin="gradient" rgb1=".75 .85 .95" rgb2="1 1 1" width="16" height="16"/>
  </asset>
  <worldbody>
    <light pos="0 0 4" diffuse=".3 .3 .3" castshadow="false"/>
    <geom name="floor" type="plane" size="3 3 .1" material="floor"/>
    <camera name="scene" pos="1.6 -1.6 1.6" xyaxes="1 1 0 -.4 .4 1"/>
    <body name="goal" mocap="true" pos="0 0 1">
      <geom type="sphere" size=".03" rgba=".1 .6 .5 .7" contype="0" conaffinity="0"/>
    </body>
    <body name="carriage" gravcomp="1">
      <joint name="x" type="slide" axis="1 0 0" damping="2"/>
      <joint name="y" type="slide" axis="0 1 0" damping="2"/>
      <joint name="z" type="slide" axis="0 0 1" damping="2"/>
      <geom name="hull" type="box" size=".09 .09 .02" mass=".8" rgba=".25 .3 .4 1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.12" size=".012" mass=".1" rgba=".9 .45 .2 1" contype="0"
        conaffinity="0"/>
      <site name="ee" pos="0 0 -.12"/>
      <camera name="wrist" pos=".1 0 -.02" xyaxes="0 -1 0 1 0 .5" fovy="80"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="x" kp="60" kv="10"/><position joint="y" kp="60" kv="10"/><position joint="z" kp="60" kv="10"/>
  </actuator>
</mujoco>
"""

SPEC = EnvSpec(
    robot="carriage",
    task="hover",
    tier="calm",
    observation=ObservationSpec(
        (
            Field("ee_pos", (3,), "proprio", unit="m", labels=("x", "y", "z")),
            Field("goal_pos", (3,), "task", unit="m", labels=("x", "y", "z")),
        )
    ),
    action=ActionSpec(
        "ee_pose",
        ("x", "y", "z", "gripper"),
        ("m", "m", "m", ""),
        np.array([-1.0, -1.0, -0.2, 0.0]),
        np.array([1.0, 1.0, 1.6, 1.0]),
    ),
    control_dt_s=DT_S,
    max_steps=250,
    instruction="Hold the end effector at the green ball.",
    subtasks=("near", "at_goal"),
    state_size=mujoco.mj_stateSize(mujoco.MjModel.from_xml_string(SCENE), mujoco.mjtState.mjSTATE_INTEGRATION),
)


class HoverBatch(BatchEnvBase):
    """n worlds of the carriage; a fifth of the seeds put the goal above what the action bounds can reach."""

    spec = SPEC
    camera_names = ("scene", "wrist")

    def __init__(self, num_envs: int, *, renders: bool = True) -> None:
        self.num_envs, self.renders = num_envs, renders
        self.model_xml = SCENE
        self.model = mujoco.MjModel.from_xml_string(SCENE)
        self.worlds = [mujoco.MjData(self.model) for _ in range(num_envs)]
        self.seeds = np.zeros(num_envs, dtype=np.int64)
        self.steps = np.zeros(num_envs, dtype=np.int64)
        self.dwell = np.zeros(num_envs, dtype=np.int64)
        self.resets: list[int] = []
        self._renderer: mujoco.Renderer | None = None

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        seeds = seeds + np.arange(self.num_envs) if np.ndim(seeds) == 0 else np.asarray(seeds)
        for i in self._chosen(mask):
            rng = episode_rng("carriage", "hover", "calm", int(seeds[i]))
            data = self.worlds[i]
            mujoco.mj_resetData(self.model, data)
            data.qpos[:] = rng.uniform([-0.3, -0.3, 0.8], [0.3, 0.3, 1.2])
            data.mocap_pos[0] = rng.uniform([-0.6, -0.6, 0.6], [0.6, 0.6, 1.4])
            if rng.random() < 0.2:
                data.mocap_pos[0, 2] = 2.0
            data.ctrl[:] = data.qpos
            mujoco.mj_forward(self.model, data)
            self.seeds[i], self.steps[i], self.dwell[i] = seeds[i], 0, 0
            self.resets.append(int(seeds[i]))
        return self._observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        executed = self.spec.action.clip(actions)
        chosen = self._chosen(mask)
        for i in chosen:
            if not np.all(np.isfinite(actions[i])):
                raise SimulationDivergedError("A non-finite action", seed=int(self.seeds[i]), step=int(self.steps[i]))
            self.worlds[i].ctrl[:] = executed[i, :3] + [0, 0, 0.12]
            for _ in range(SUBSTEPS):
                mujoco.mj_step(self.model, self.worlds[i])
            mujoco.mj_kinematics(self.model, self.worlds[i])
            self.steps[i] += 1
        return self._result(executed, chosen)

    def _result(self, executed: np.ndarray, chosen: list[int]) -> StepResult:
        obs = self._observe()
        distance = np.sqrt(((obs["ee_pos"] - obs["goal_pos"]) ** 2).sum(1))
        for i in chosen:
            self.dwell[i] = self.dwell[i] + 1 if distance[i] < TOLERANCE_M else 0
        crash = obs["ee_pos"][:, 2] < 0.0
        success = self.dwell >= DWELL_STEPS
        effort = np.array([float(np.mean(d.actuator_force**2)) for d in self.worlds]) / 1e4
        info = {
            "success": success,
            "crash": crash,
            "subtasks": np.stack([distance < 0.1, distance < TOLERANCE_M], axis=1),
            "sparse_reward": success.astype(float),
            "ee_error_m": np.sqrt(((obs["ee_pos"] - executed[:, :3]) ** 2).sum(1)),
            "effort": effort,
            "contacts": np.array([d.ncon for d in self.worlds]),
            "executed_action": executed,
        }
        return StepResult(obs, np.exp(-3 * distance), crash, self.steps >= self.spec.max_steps, info)

    def render(self, world: int, camera: str = "scene", height: int = 240, width: int = 320) -> np.ndarray:
        if not self.renders:
            raise mujoco.FatalError("gladLoadGL error")
        if self._renderer is None or (self._renderer.height, self._renderer.width) != (height, width):
            self._renderer = mujoco.Renderer(self.model, height, width)
        self._renderer.update_scene(self.worlds[world], camera)
        return self._renderer.render()

    def _observe(self) -> dict[str, np.ndarray]:
        return {
            "ee_pos": np.stack([d.site_xpos[0] for d in self.worlds]),
            "goal_pos": np.stack([d.mocap_pos[0] for d in self.worlds]),
        }

    def _chosen(self, mask: np.ndarray | None) -> list[int]:
        return list(range(self.num_envs)) if mask is None else np.flatnonzero(mask).tolist()


class GoThere:
    """Lead the end effector to the goal; with ``dive``, into the floor where the goal lies at negative x."""

    phase_names = ("fly", "hold")

    def __init__(self, *, dive: bool = False) -> None:
        self.dive, self.resets = dive, 0
        self.phase = np.zeros(0, dtype=int)
        self.env: Any = None

    def attach(self, env: Any) -> None:
        self.env, self.phase = env, np.zeros(env.num_envs, dtype=int)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.resets += int(np.sum(mask)) if mask is not None else len(self.phase)

    def act(self, obs: Any) -> np.ndarray:
        goal = obs["goal_pos"].copy()
        self.phase = (np.abs(goal - obs["ee_pos"]).max(1) < TOLERANCE_M).astype(int)
        if self.dive:
            goal[goal[:, 0] < 0, 2] = -0.2
        step = np.clip(goal - obs["ee_pos"], -LEAD_M, LEAD_M)
        return np.concatenate([obs["ee_pos"] + step, self.phase[:, None]], axis=1)
