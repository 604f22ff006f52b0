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
# # 4. Demonstrations: record, look, convert, read in rerun
#
# A policy can be no better than what it was shown. So before anything is learned: record demonstrations, look at them, find out
# whether they can be trusted, and hand them to other tools. Each step is a command; the notebook runs the same commands and then
# opens their results in Python. Everything can be read without running it.
#
# A **demonstration** here is one flight of a task, fifty steps a second. Each step holds what was seen (*observation*), what was
# commanded (*action*), what it was worth (*reward*), and the whole state of the simulator, so that the flight can be flown again.

# %%
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from IPython.display import Image as Picture
from PIL import Image

import aerial_il
from aerial_il.presentation import analysis
from aerial_il.core.rendering import can_render
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.films.stroboscope import stroboscope

analysis.use_style()
os.chdir(tempfile.mkdtemp())  # the notebook leaves nothing behind


def command(line):
    """Run `aerial-il LINE` and print what it says."""
    told = subprocess.run([sys.executable, "-m", "aerial_il", *line.split()], capture_output=True, text=True, check=False)
    refused = [row for row in told.stderr.splitlines() if row.startswith(("error", "Error"))]
    print(f"$ aerial-il {line}", told.stdout.strip(), *refused, f"(status {told.returncode})", sep="\n")


# %% [markdown]
# ## 4.1 Record
#
# `pick_place` with `fa_hexa_arm4`, a vehicle with six fixed, tilted rotors: take a cube off a table and let go of it in a bowl. The
# demonstrator is a script that sees the simulator's true state, the *expert*. (A person can fly, too: `aerial-il teleop` records into
# the same format.) `expert.noise` disturbs its commands on the way, slowly enough that the vehicle really goes elsewhere; the
# expert then corrects. Why on purpose? A flight without errors shows no corrections, and a learner will need them (notebook 6).

# %%
EPISODES = 24
dataset = aerial_il.collect("fa_hexa_arm4", "pick_place", episodes=EPISODES, seed=0, out="datasets/pick", progress=False)
command("info datasets/pick")

# %% [markdown]
# The call is the command `aerial-il collect robot=fa_hexa_arm4 task=pick_place episodes=24 out=datasets/pick`. Had it been
# interrupted, the same command would have gone on: an episode is a file of its own, written during the flight.
#
# ## 4.2 Look
#
# The whole flight in one picture: several moments of it, and the paths of base and tool.

# %%
def shown(picture):
    """A picture as a small JPEG."""
    kept = io.BytesIO()
    Image.fromarray(picture).save(kept, "JPEG", quality=80)
    display(Picture(data=kept.getvalue(), format="jpeg"))  # noqa: F821  (the notebook's own)


flight = dataset[0]
if can_render():
    shown(stroboscope(flight, 400, 720))


# %%
def film(episode, every=12, height=200, width=300):
    """A recorded flight in real time, drawn from its recorded states."""
    with SceneRenderer(episode.model_xml) as scene:
        view = scene.frame(episode.states[::20], width / height)
        pictures = [Image.fromarray(scene.draw(state, view, height, width)) for state in episode.states[::every]]
    small, kept = [picture.quantize(48) for picture in pictures], io.BytesIO()
    small[0].save(kept, "GIF", save_all=True, append_images=small[1:], duration=20 * every, loop=0)
    display(Picture(data=kept.getvalue(), format="gif"))  # noqa: F821  (the notebook's own)


if can_render():
    film(flight)

# %% [markdown]
# Now the numbers. An episode of $T$ steps has $T$ actions and $T+1$ observations: what was seen before each step, and what was seen
# at the end. All are arrays with names; the specification gives unit and meaning of every element.

# %%
for field in flight.spec.observation.fields[:6]:
    print(f"{field.name:14s} {field.shape!s:6s} {field.unit:8s}", flight.obs[field.name][0].round(2))
print("...", len(flight.spec.observation.fields), "fields in all;", flight.spec.action.size, "elements of an action:")
print(", ".join(flight.spec.action.labels))

# %%
time_s = flight.sim_time[:-1] - flight.sim_time[0]
names = flight.provenance["phases"]
figure, axes = plt.subplots(1, 3, figsize=(13, 3.2), layout="constrained")
begins = np.flatnonzero(np.diff(flight.phase, prepend=-2))
for axis in axes[:2]:
    for first, last in zip(begins, [*begins[1:], len(flight) - 1], strict=True):
        axis.axvspan(time_s[first], time_s[last], color=f"C{flight.phase[first]}", alpha=0.15, lw=0)
for k, label in enumerate("xyz"):
    axes[0].plot(time_s, flight.obs["ee_pos"][:-1, k], color=f"C{k}", label=label)
    axes[0].plot(time_s, flight.actions[:, k], ":", color=f"C{k}")
axes[0].set(xlabel="time (s)", ylabel="position (m)", title="tool (solid) and its command (dotted)")
axes[0].legend()
axes[1].step(time_s, flight.phase, color="0.3", where="post", label="phase")
axes[1].plot(time_s, -1.5 + flight.actions[:, -1], color="C1", label="gripper: up is open")
axes[1].set_yticks(range(len(names)), names)
axes[1].set(xlabel="time (s)", title="the expert's phase, and the gripper", ylim=(-1.8, len(names) - 0.5))
axes[1].legend(loc="upper left")
for episode in dataset:
    tool, bowl = episode.obs["ee_pos"], episode.obs["bowl_pos"][0]
    axes[2].plot(tool[:, 0], tool[:, 1], lw=0.6, color="0.5")
    axes[2].plot(*tool[0, :2], "o", ms=4, color="C0")
    axes[2].plot(*bowl[:2], "s", ms=5, color="C1")
axes[2].set(xlabel="x (m)", ylabel="y (m)", title=f"{len(dataset)} flights from above: start, bowl", aspect="equal")
plt.show()

# %% [markdown]
# Left: the command runs ahead of the tool, because the tool follows with a delay. What a policy learns is the dotted line. The colours
# are the phases of the expert's script; a policy is not told them. Right: every seed is another start.
#
# `analysis.dataset` gives one row per flight, `analysis.steps` one row per step, as pandas frames.

# %%
table = analysis.dataset("datasets/pick")
print(f"{table['success'].sum()} of {len(table)} succeeded; {table['steps'].sum()} steps")
table[["seed", "success", "steps", "duration_s", "return"]].describe().loc[["min", "mean", "max"]].round(2)

# %% [markdown]
# **What did the noise do?** The same seeds, without it. A plain measure of coverage: divide the space around the cube that is to be
# gripped into cells of 1 cm edge, and count those that the tool visited within 10 cm sideways and 15 cm above it.

# %%
clean = aerial_il.collect(
    "fa_hexa_arm4", "pick_place", episodes=EPISODES, seed=0, expert={"noise": 0}, out="datasets/clean", progress=False
)


def beside_the_cube(episode):
    return episode.obs["ee_pos"] - episode.obs["cube_pos"][0]


figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), sharex=True, sharey=True, layout="constrained")
for axis, (name, flights) in zip(axes, {"without noise": clean, "noise 0.3 (the default)": dataset}.items(), strict=True):
    paths = [beside_the_cube(one) for one in flights]
    for path in paths:
        axis.plot(100 * path[:, 0], 100 * path[:, 2], lw=0.6, color="C0", alpha=0.6)
    near = np.concatenate([path[(np.abs(path[:, :2]).max(axis=1) < 0.1) & (path[:, 2] < 0.15)] for path in paths])
    cells = len(np.unique(np.floor(near / 0.01).astype(int), axis=0))
    axis.set(title=f"{name}: {cells} cells in {len(near)} steps", xlabel="x from the cube (cm)", xlim=(-10, 10), ylim=(0, 20))
axes[0].set_ylabel("z from the cube (cm)")
plt.show()

# %% [markdown]
# ## 4.3 Can they be trusted?
#
# `validate` reads every file in full: checksums, shapes, times, bounds, how it ends. `replay` is stricter: it flies each episode again from
# its recorded actions and requires every state to be equal, to the last bit.

# %%
command("validate datasets/pick")
command("replay datasets/pick")

# %% [markdown]
# A test that cannot fail is worth nothing. So change one bit of one file of a copy:

# %%
shutil.copytree("datasets/pick", "datasets/damaged")
victim = sorted(Path("datasets/damaged/demos").glob("*.mcap"))[3]
content = bytearray(victim.read_bytes())
content[len(content) // 2] ^= 1
victim.write_bytes(content)
command("validate datasets/damaged")

# %% [markdown]
# ## 4.4 Convert
#
# The recordings are the truth; everything else is derived from them and can be made again. Three readers: **LeRobot** (a v3 dataset: Parquet
# tables and videos), **robomimic** (one HDF5 file), **rerun** (a viewer).

# %%
command("convert datasets/pick progress=false")
command("convert datasets/pick out=pick.hdf5 progress=false")
command("inspect datasets/pick episode=0 save=flight.rrd")

# %% [markdown]
# Do they hold the same numbers? Open each with the tool that anybody would use, not with ours, and compare with the recording. One thing to know first: a demonstration with noise has two
# actions in each step, the one that was *flown* and the one that the expert *meant*. The second is the label, what a learner should answer in this state; LeRobot's file has room for
# one only, and gets the label.

# %%
[parquet] = Path("datasets/pick/derived/lerobot/data").rglob("*.parquet")
frames = pd.read_parquet(parquet)
features = json.loads(Path("datasets/pick/derived/lerobot/meta/info.json").read_text())["features"]
own, shown_by_task = (features[name]["names"] for name in ("observation.state", "observation.environment_state"))
print(frames.shape[0], "frames;", len(own), "elements of the robot,", len(shown_by_task), "of the task;", "columns", list(frames.columns))
first = frames[frames["episode_index"] == 0]
same = np.array_equal(np.stack(first["action"]), flight.labels)
print("LeRobot, actions of the first flight equal to the labels to the bit:", same)
apart = 100 * np.linalg.norm((flight.labels - flight.executed_actions)[:, :3], axis=1)
print(f"what the expert meant less what the noise made of it: {apart.mean():.2f} cm on average, at most {apart.max():.1f} cm")

with h5py.File("pick.hdf5") as file:
    demo = next(group for group in file["data"].values() if group.attrs["uid"] == flight.uid)
    print("robomimic:", ", ".join(sorted(demo)), "and", len(demo["obs"]), "observations")
    same = all(np.array_equal(demo["obs"][name][:], flight.obs[name][:-1]) for name in demo["obs"])
    print("robomimic, observations and actions equal to the bit:", same and np.array_equal(demo["actions"][:], flight.actions))

# %%
def size_mb(path):
    path = Path(path)
    return sum(f.stat().st_size for f in (path.rglob("*") if path.is_dir() else [path]) if f.is_file()) / 1e6


for name, path in {
    "MCAP, the recordings": "datasets/pick/demos", "LeRobot": "datasets/pick/derived/lerobot", "robomimic": "pick.hdf5",
}.items():
    print(f"{name:22s} {size_mb(path):6.2f} MB for {len(dataset)} flights")
print(f"{'rerun':22s} {size_mb('flight.rrd'):6.2f} MB for one flight")

# %% [markdown]
# LeRobot's file is small because it leaves out the simulator's state, so it cannot be replayed. That is why it is not the original.
#
# ## 4.5 Read in rerun
#
# `aerial-il inspect datasets/pick episode=0` opens the viewer: the scene in motion, forces as arrows, images, phases, every signal on one
# timeline. This is what it looks like (made by the same command with `screenshot=`, from a flight with cameras in gusts):
#
# ![A cube is lifted: scene, phases and sub-tasks, wrist and scene cameras, actions, joints, contact forces, reward](../docs/inspect/pick_place.webp)
#
# A file for a viewer is data as well. rerun stores *entities*, named like paths, each with *components* over *timelines*:

# %%
from rerun.chunk import RrdReader

chunks = RrdReader("flight.rrd").stream().to_chunks()
entities = sorted({str(chunk.entity_path) for chunk in chunks})
groups = pd.Series([entity.split("/")[1] for entity in entities if entity.count("/") > 1]).value_counts()
print(len(entities), "entities:", groups.to_dict())
print([entity for entity in entities if entity.startswith("/signals")][:8])


def column(entity, name):
    """All values of a component or a timeline of an entity, as numbers, in order."""
    batches = [chunk.to_record_batch() for chunk in chunks if str(chunk.entity_path) == entity]
    values = [batch.column(name).flatten() if name != "sim_time" else batch.column(name) for batch in batches if name in batch.schema.names]
    return np.concatenate([np.asarray(part.cast("int64") if name == "sim_time" else part) for part in values])


reward = column("/signals/reward", "Scalars:scalars")
when_s = column("/signals/reward", "sim_time") / 1e9
print("rewards in the file equal to the recording's:", np.array_equal(reward, flight.rewards))
figure, axes = plt.subplots(figsize=(6.4, 2.6), layout="constrained")
axes.plot(when_s, reward, lw=4, color="0.8", label="from the file of rerun")
axes.plot(time_s, flight.rewards, lw=1, label="from the recording")
axes.set(xlabel="time (s)", ylabel="reward")
axes.legend()
plt.show()

# %% [markdown]
# ## 4.6 Which demonstrations count?
#
# - `train dataset.episodes=10` takes the first ten successes; `algorithm.selection` chooses by length, smoothness or pilot
#   ([training](../docs/training.md#which-demonstrations-count)). Failures are kept apart and not learned from unless you say so.
# - One folder, one setting: `collect` refuses to add flights of another disturbance tier or another expert's noise, unless `mix=true`.
# - Seeds below 5000 are for demonstrations here, 5000 to 9999 for tuning, and from 10000 on for judging. A test on the starts that were
#   demonstrated says nothing.
#
# The format is [specified](../docs/data_format.md), down to the bytes. Next: learn from them (notebook 5), and what happens where no
# demonstration has been (notebook 6).
#
# **Sources.** Mandlekar et al., "What matters in learning from offline human demonstrations", *CoRL* 2021 (robomimic and its file).
# Cadene et al., *LeRobot*, 2024. Laskey et al., "DART: noise injection for robust imitation learning", *CoRL* 2017 (why noise helps).
