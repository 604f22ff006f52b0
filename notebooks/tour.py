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
# # A tour in five minutes
#
# Load a vehicle with a task, let the expert fly it, record demonstrations, open them again, look at them.
# Open this file as a notebook with Jupyter and jupytext, or run it as it is.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.rendering import can_render

print("robots", aerial_il.list_robots())
print("tasks ", aerial_il.list_tasks())

# %% [markdown]
# ## One world
#
# `load` gives a real `dm_control` environment. An expert is a policy that sees the simulator; policies act on
# observations with a leading world axis, so a single world is a batch of one.

# %%
env = aerial_il.load("ua_quad_arm4", "reach", tier="calm", seed=0)
expert = aerial_il.expert("ua_quad_arm4", "reach")
expert.attach(env)
expert.reset()
step, rewards = env.reset(), []
while not step.last() and not env.info["success"]:
    obs = {name: value[None] for name, value in step.observation.items()}
    step = env.step(expert.act(obs)[0])
    rewards.append(step.reward)
print(f"{env.spec.instruction} Solved after {len(rewards) * env.spec.control_dt_s:.1f} s.")

# %%
if can_render():
    plt.imshow(env.render("scene"))
    plt.axis("off")
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
