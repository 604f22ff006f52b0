"""A small real-MuJoCo batch environment with the suite's interface: a crane that moves a hook to a goal.

It keeps the tests of recording, collection and evaluation fast, and brings outcomes about on demand: a fifth of the
goals lie out of reach (time-out), and a goal at negative x is below the floor for an expert that dives (crash).
"""

from functools import cache

import mujoco
import numpy as np

from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.errors import SimulationDivergedError
from aerial_il.core.seeding import episode_rng
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec

SUBSTEPS, DWELL_STEPS, TOLERANCE_M = 5, 5, 0.03
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION

SCENE = """
<mujoco model="crane">
  <option timestep="0.004" integrator="implicitfast"/>
  <worldbody>
    <light pos="0 0 4" castshadow="false"/>
    <geom name="floor" type="plane" size="3 3 .1" rgba=".8 .8 .8 1"/>
    <camera name="scene" pos="1.6 -1.6 1.6" xyaxes="1 1 0 -.4 .4 1"/>
    <body name="goal" mocap="true" pos="0 0 1">
      <geom type="sphere" size=".03" rgba=".1 .6 .5 .7" contype="0" conaffinity="0"/>
    </body>
    <body name="base" gravcomp="1">
      <joint name="x" type="slide" axis="1 0 0" damping="2"/>
      <joint name="z" type="slide" axis="0 0 1" damping="2"/>
      <geom type="box" size=".09 .09 .02" mass=".8" rgba=".3 .3 .4 1"/>
      <camera name="wrist" pos=".1 0 -.02" xyaxes="0 -1 0 1 0 .5" fovy="80"/>
      <body name="hook">
        <joint name="swing" axis="0 1 0" damping=".05"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".012" mass=".1" rgba=".9 .5 .2 1"/>
        <site name="ee" pos="0 0 -.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="x" kp="60" kv="12"/><position joint="z" kp="60" kv="12"/>
  </actuator>
</mujoco>
"""


@cache
def crane_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


def crane_spec(image_size: tuple[int, int] | None = None, max_steps: int = 120) -> EnvSpec:
    xyz = ("x", "y", "z")
    fields = [
        Field("base_pos", (3,), "proprio", unit="m", labels=xyz),
        Field("base_rot6d", (6,), "proprio"),
        Field("joint_pos", (3,), "proprio", unit="rad", labels=("x", "z", "swing")),
        Field("joint_vel", (3,), "proprio", labels=("x", "z", "swing")),
        Field("ee_pos", (3,), "proprio", unit="m", labels=xyz),
        Field("gripper", (1,), "proprio", dtype="float32"),
        Field("goal_pos", (3,), "task", unit="m", labels=xyz),
    ]
    if image_size:
        fields.append(Field("scene_rgb", (*image_size, 3), "image", dtype="uint8"))
    return EnvSpec(
        robot="crane",
        task="reach",
        tier="calm",
        observation=ObservationSpec(tuple(fields)),
        action=ActionSpec("base", ("x", "z"), ("m", "m"), np.array([-1.0, -0.5]), np.array([1.0, 2.0])),
        control_dt_s=0.02,
        max_steps=max_steps,
        instruction="Bring the hook to the ball.",
        subtasks=("near", "at_goal"),
        state_size=mujoco.mj_stateSize(crane_model(), INTEGRATION) + 3,
    )


class CraneBatch(BatchEnvBase):
    """n cranes; its state is MuJoCo's plus the seed, the step count and the dwell count."""

    camera_names = ("scene", "wrist")

    def __init__(
        self,
        num_envs: int = 1,
        *,
        image_size: tuple[int, int] | None = None,
        max_steps: int = 120,
        renders: bool = True,
    ) -> None:
        self.spec, self.num_envs = crane_spec(image_size, max_steps), num_envs
        self.model, self.model_xml = crane_model(), SCENE
        self.worlds = [mujoco.MjData(self.model) for _ in range(num_envs)]
        self.seeds, self.steps, self.dwell = (np.zeros(num_envs, np.int64) for _ in range(3))
        self.stepped, self.resets, self.renders = 0, list[int](), renders
        self._shown: mujoco.Renderer | None = None  # of pictures that are no observations
        self._renderer = mujoco.Renderer(self.model, *image_size) if image_size else None

    @property
    def ctrl(self) -> np.ndarray:
        return np.stack([data.ctrl for data in self.worlds])

    @property
    def sim_time(self) -> np.ndarray:
        return np.array([data.time for data in self.worlds])

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        seeds = seeds + np.arange(self.num_envs) if np.ndim(seeds) == 0 else np.asarray(seeds)
        for i in self._chosen(mask):
            rng = episode_rng("crane", "reach", "calm", int(seeds[i]))
            data = self.worlds[i]
            mujoco.mj_resetData(self.model, data)
            data.qpos[:2] = rng.uniform([-0.3, 0.8], [0.3, 1.2])
            data.mocap_pos[0] = rng.uniform([-0.6, 0, 0.4], [0.6, 0, 1.0])
            if rng.random() < 0.2:
                data.mocap_pos[0, 2] = 2.5
            data.ctrl[:] = data.qpos[:2]
            mujoco.mj_forward(self.model, data)
            self.seeds[i], self.steps[i], self.dwell[i] = seeds[i], 0, 0
            self.resets.append(int(seeds[i]))
        return self._observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        executed, chosen = self.spec.action.clip(actions), self._chosen(mask)
        for i in chosen:
            if not np.all(np.isfinite(actions[i])):
                raise SimulationDivergedError("A non-finite action", seed=int(self.seeds[i]), step=int(self.steps[i]))
            self.worlds[i].ctrl[:] = executed[i]
            for _ in range(SUBSTEPS):
                mujoco.mj_step(self.model, self.worlds[i])
            mujoco.mj_kinematics(self.model, self.worlds[i])
            mujoco.mj_camlight(self.model, self.worlds[i])
            self.steps[i] += 1
            self.stepped += 1
        obs = self._observe()
        distance = np.sqrt(((obs["ee_pos"] - obs["goal_pos"]) ** 2).sum(1))
        for i in chosen:
            self.dwell[i] = self.dwell[i] + 1 if distance[i] < TOLERANCE_M else 0
        crash = obs["ee_pos"][:, 2] < 0.0
        success = self.dwell >= DWELL_STEPS
        info = {
            "success": success,
            "crash": crash,
            "subtasks": np.stack([distance < 0.1, distance < TOLERANCE_M], axis=1),
            "sparse_reward": success.astype(float),
            "ee_error_m": np.sqrt(((obs["base_pos"][:, [0, 2]] - executed) ** 2).sum(1)),
            "effort": np.array([float(np.mean(d.actuator_force**2)) for d in self.worlds]) / 1e4,
            "contacts": np.array([d.ncon for d in self.worlds]),
            "executed_action": executed,
        }
        return StepResult(obs, np.exp(-3 * distance), crash, self.steps >= self.spec.max_steps, info)

    def get_state(self) -> np.ndarray:
        state = np.zeros((self.num_envs, self.spec.state_size))
        for i, data in enumerate(self.worlds):
            mujoco.mj_getState(self.model, data, state[i, :-3], INTEGRATION)
            state[i, -3:] = self.seeds[i], self.steps[i], self.dwell[i]
        return state

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        for i in self._chosen(mask):
            mujoco.mj_setState(self.model, self.worlds[i], states[i, :-3], INTEGRATION)
            mujoco.mj_kinematics(self.model, self.worlds[i])
            mujoco.mj_camlight(self.model, self.worlds[i])
            self.seeds[i], self.steps[i], self.dwell[i] = states[i, -3:]
        return self._observe()

    def render(self, world: int, camera: str = "scene", height: int = 240, width: int = 320) -> np.ndarray:
        if not self.renders:
            raise mujoco.FatalError("gladLoadGL error")
        if self._shown is None or (self._shown.height, self._shown.width) != (height, width):
            self._shown = mujoco.Renderer(self.model, height, width)
        self._shown.update_scene(self.worlds[world], camera)
        return self._shown.render()

    def close(self) -> None:
        if self._renderer:
            self._renderer.close()

    def _observe(self) -> dict[str, np.ndarray]:
        position = np.stack([d.xpos[2] for d in self.worlds])
        obs = {
            "base_pos": position,
            "base_rot6d": np.tile([1.0, 0, 0, 0, 1, 0], (self.num_envs, 1)),
            "joint_pos": np.stack([d.qpos for d in self.worlds]),
            "joint_vel": np.stack([d.qvel for d in self.worlds]),
            "ee_pos": np.stack([d.site_xpos[0] for d in self.worlds]),
            "gripper": np.ones((self.num_envs, 1), np.float32),
            "goal_pos": np.stack([d.mocap_pos[0] for d in self.worlds]),
        }
        if self._renderer:
            obs["scene_rgb"] = np.stack([self._render(data) for data in self.worlds])
        return obs

    def _render(self, data: mujoco.MjData) -> np.ndarray:
        self._renderer.update_scene(data, "scene")
        return self._renderer.render()

    def _chosen(self, mask: np.ndarray | None) -> list[int]:
        return list(range(self.num_envs)) if mask is None else np.flatnonzero(mask).tolist()


class CraneExpert:
    """Move the base above the goal; with ``dive``, into the floor where the goal lies at negative x.

    Args:
        dive: crash on purpose.
        noise: deviation of the noise added to what is flown, in metres; a function of the world's seed and step.
    """

    phase_names = ("fly", "hold")

    def __init__(self, *, dive: bool = False, noise: float = 0.0) -> None:
        self.dive, self.noise, self.resets = dive, noise, 0
        self.phase, self.expert_action = np.zeros(0, int), np.zeros((0, 2))

    def attach(self, env: CraneBatch) -> None:
        self.env, self.phase = env, np.zeros(env.num_envs, int)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.resets += len(self.phase) if mask is None else int(np.sum(mask))

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        goal = obs["goal_pos"]
        self.phase = (np.abs(goal - obs["ee_pos"]).max(1) < TOLERANCE_M).astype(int)
        target = self.env.spec.action.clip(np.stack([goal[:, 0], goal[:, 2] + 0.3], axis=1))
        if self.dive:
            target[goal[:, 0] < 0, 1] = -0.2
        self.expert_action = target
        if not self.noise:
            return target
        seeds = zip(self.env.seeds.tolist(), self.env.steps.tolist(), strict=True)
        return target + self.noise * np.stack([np.random.default_rng(pair).standard_normal(2) for pair in seeds])
