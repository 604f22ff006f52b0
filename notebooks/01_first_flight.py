# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # 1. A first flight
#
# What the robot is, what a task is, who flies: load a vehicle with a task, let the expert fly it, record demonstrations, open them
# again, look at them. Everything can be read without running it; to run it, open it with Jupyter.
#
# **The robot.** An *aerial manipulator* is a vehicle that flies and has an arm. The one here, `ua_quad_arm4`, is a quadrotor of
# 2.3 kg. Four rotors lift it and turn it; a quadrotor cannot push sideways and has to lean (it is *under-actuated*). Below it hangs
# an arm of four joints, one that rolls and three that pitch, with a gripper.
#
# **What is commanded.** Fifty times a second somebody, a person, a script or a neural network (a *policy*), says where the gripper
# should be. A controller turns that into thrusts and joint torques 250 times a second: notebook 2 is about it.
#
# **What is shown.** An *observation*: positions and velocities of base, joints and tool, and what the task adds, such as a target.
#
# **The task.** `reach`: bring the gripper to a marked pose, within 2 cm and 10 degrees, for one second.

# %%
import io
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Image as Film
from PIL import Image

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.rendering import can_render

print("robots", aerial_il.list_robots())
print("tasks ", aerial_il.list_tasks())

# %% [markdown]
# ## The vehicle in figures

# %%
from aerial_il import robots
from aerial_il.robots.figures import hover_power, stances

robot = robots.get("ua_quad_arm4")
print(f"{robot.vehicle.mass:.2f} kg, thrust to weight {robot.vehicle.thrust_to_weight:.1f}, reach {robot.arm.reach:.2f} m,")
print(f"ideal hover power {hover_power(robot):.0f} W")
for stance in stances(robot):
    print(f"{stance.name:16s} centre of mass {100 * stance.com[0]:4.1f} cm ahead; rotors lift {stance.thrust.round(1)} N")

# %% [markdown]
# With the arm stretched ahead the centre of mass moves ahead too, and the front rotors have to lift more: the arm and the vehicle
# are one machine.
#
# ## One world
#
# `load` gives a real `dm_control` environment. An expert is a policy that sees the simulator; policies act on
# observations with a leading world axis, so a single world is a batch of one.

# %%
env = aerial_il.load("ua_quad_arm4", "reach", tier="calm", seed=0)
expert = aerial_il.expert("ua_quad_arm4", "reach")
expert.attach(env)
expert.reset()
step, rewards, pictures = env.reset(), [], []
while not step.last() and not env.info["success"]:
    obs = {name: value[None] for name, value in step.observation.items()}
    step = env.step(expert.act(obs)[0])
    rewards.append(step.reward)
    if can_render() and len(rewards) % 10 == 0:
        pictures.append(Image.fromarray(env.render("scene", 180, 240)))
print(f"{env.spec.instruction} Solved after {len(rewards) * env.spec.control_dt_s:.1f} s.")

# %%
if pictures:
    kept = io.BytesIO()
    small = [picture.quantize(48) for picture in pictures]
    small[0].save(kept, format="GIF", save_all=True, append_images=small[1:], duration=200, loop=0)
    display(Film(data=kept.getvalue(), format="gif"))  # noqa: F821  (the notebook's own)

# %% [markdown]
# The small marker is the target. The reward of each step, between 0 and 1, grows as the tool comes near and turns as the marker shows.

# %%
figure, axes = plt.subplots(figsize=(5, 3))
axes.plot(env.spec.control_dt_s * np.arange(len(rewards)), rewards)
axes.set(xlabel="time (s)", ylabel="reward", title="one flight of the expert")
figure.tight_layout()
plt.show()

# %% [markdown]
# ## Many worlds, recorded
#
# `load_batch` steps many worlds of the same task on all cores. Each episode becomes one MCAP file.

# %%
folder = Path(tempfile.mkdtemp()) / "reach"
worlds = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=8)
collection = collect(worlds, aerial_il.expert("ua_quad_arm4", "reach"), range(8), folder, progress=False)
worlds.close()
print(collection.summary())

# %% [markdown]
# ## What was recorded

# %%
dataset = aerial_il.open_dataset(folder)
figure, (path, distance) = plt.subplots(1, 2, figsize=(9, 3.5))
for episode in dataset:
    ee_pos, target_pos = episode.obs["ee_pos"], episode.obs["target_pos"]
    path.plot(ee_pos[:, 0], ee_pos[:, 1])
    distance.plot(episode.sim_time - episode.sim_time[0], 100 * np.linalg.norm(ee_pos - target_pos, axis=1))
path.set(xlabel="x (m)", ylabel="y (m)", title="end effector from above", aspect="equal")
distance.set(xlabel="time (s)", ylabel="distance to the target (cm)", title=f"{len(dataset)} demonstrations")
env.close()
figure.tight_layout()
plt.show()

# %% [markdown]
# From here: `aerial-il train dataset=... run=...` learns a policy, `aerial-il evaluate policy=... out=...` judges it.
