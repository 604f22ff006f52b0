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
# # 5. Behaviour cloning: why chunks, and why more than one answer
#
# Somebody has shown how it is done; learn to do the same from what was seen and what was done. That is supervised learning, and it
# has two traps that ordinary supervised learning does not have. Demonstrators *pause*, and a network that sees only the present
# cannot tell how long it has waited. And demonstrators do the same thing *in several ways*, whose mean may be none of them. The
# notebook shows each trap in the smallest example that has it, then what is left of the first one on a robot that picks up a cube.
# Everything can be read without running it.

# %%
import contextlib
import io
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch

import aerial_il
from aerial_il.presentation import analysis
from aerial_il.evaluation import statistics
from aerial_il.evaluation.rollouts import rollouts
from aerial_il.experts import pick_place
from aerial_il.policies.flow import Flow
from aerial_il.policies.gmm import GMM
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.chunking import ActionPlan

analysis.use_style()
torch.set_num_threads(1)

# %% [markdown]
# ## 5.1 What is learned
#
# Demonstrations are pairs $(o_t, a_t)$ of an observation and an action. Behaviour cloning looks for the network $f_\theta$ with the
# smallest mean loss on them. What would a network learn that is as large as one likes, with as much data as one likes? For each $o$
# it answers alone, and the answer depends on the loss:
#
# $$ \frac{d}{da}\,\mathbb E\,[(a-A)^2\mid o]=2\,(a-\mathbb E[A\mid o])=0 \quad\Rightarrow\quad a=\mathbb E[A\mid o],\ \text{the mean,} $$
#
# $$ \frac{d}{da}\,\mathbb E\,[\,|a-A|\,\mid o]=P(A<a\mid o)-P(A>a\mid o)=0 \quad\Rightarrow\quad a=\text{a median}. $$
#
# The policy `mlp` of this project takes the second loss (L1). Where each observation has one right action, mean and median are that
# action, and all is well. The rest of this notebook is about where it has several.
#
# A **chunk** is $H$ actions predicted at once, $f_\theta(o_t)=(\hat a_t,\dots,\hat a_{t+H-1})$. Three ways of flying one network:
#
# - *newest*: predict in every step, fly the first action of the newest chunk, forget the rest;
# - *whole*: fly all $H$ actions, then predict again;
# - *ensemble*: predict in every step, and fly the weighted mean of what all chunks so far say about this step (Zhao et al. 2023).
#
# A policy that predicts single actions is $H=1$, where the three are the same.
#
# ## 5.2 A pause, in one dimension
#
# A demonstrator goes from -1 to 0, waits there for $D$ steps, and goes on to 1. The network sees the place alone. At 0 it has seen
# "stay" $D$ times and "go" once: the median says *stay*, for ever. What does a chunk say there? Of the $D+1$ demonstrated moments at 0,
# those with at most $j$ steps of waiting left have gone on after $j+1$ steps: a share of $(j+1)/(D+1)$. The median of element $j$
# (counted from 0) goes on as soon as that share passes one half, $j+1>(D+1)/2$. So a *whole* chunk gets past the pause if it is longer
# than about half of it, and *newest*, which flies element 0 only, never does (for $D\ge1$).
#
# The cell does this exactly. No network is trained: for each place, the prediction is the median over the demonstrated chunks. The
# code that flies chunks is that of the project.

# %%
STEP = 0.05


def demonstrated(pause):
    return np.concatenate([np.arange(-20, 0), np.zeros(pause + 1), np.arange(1, 21)]) * STEP


def median_policy(pause, chunk):
    """place, as a number of steps -> the median chunk of all demonstrated moments at that place."""
    path = demonstrated(pause)
    padded = np.append(path, np.full(chunk, path[-1]))
    chunks = np.array([padded[t + 1 : t + 1 + chunk] for t in range(len(path))])
    where = np.round(path / STEP).astype(int)
    return {place: np.median(chunks[where == place], axis=0) for place in np.unique(where)}


def flown(pause, chunk, execute, coefficient, steps=250):
    answers, plan, x, path = median_policy(pause, chunk), ActionPlan(chunk, execute, coefficient), -1.0, []
    for _ in range(steps):
        due = plan.due(1)
        if due.any():
            plan.add(answers[int(np.clip(np.round(x / STEP), -20, 20))][None, :, None].astype(np.float32), due)
        x = float(plan.pop()[0, 0])
        path.append(x)
    return np.array(path)


def ways_of(chunk):
    return {"newest": (1, None), "whole": (chunk, None), "ensemble": (1, 0.01)}


pauses, chunks = range(0, 41, 2), range(1, 41)
figure, axes = plt.subplots(1, 4, figsize=(13, 3.2), width_ratios=(1.4, 1, 1, 1), layout="constrained")
axes[0].plot(demonstrated(20), color="0.6", lw=5, label="demonstrated")
for name, (execute, coefficient) in ways_of(16).items():
    axes[0].plot(np.append(-1, flown(20, 16, execute, coefficient, 80)), label=name)
axes[0].set(xlabel="step", ylabel="place", title="pause of 20, chunk of 16", xlim=(0, 80))
axes[0].legend()
for axis, name in zip(axes[1:], ways_of(1), strict=True):
    arrives = [[flown(D, H, *ways_of(H)[name])[-1] > 0.99 for H in chunks] for D in pauses]
    axis.pcolormesh(np.array(chunks), np.array(pauses), np.array(arrives, float), cmap="Blues", vmin=0, vmax=1.5)
    axis.plot([0.5, 20.5], [0, 40], color="C1", lw=2)
    axis.set(xlabel="length of the chunk", ylabel="length of the pause", title=f"{name}: blue arrives", xlim=(0.5, 40.5), ylim=(-1, 41))
plt.show()

# %% [markdown]
# The orange line is the derivation, chunk = half of the pause. *Whole* follows it. *Ensemble* needs chunks that are somewhat longer:
# its mean moves on once enough of the overlapping chunks do. *Newest* predicts chunks of any length and stays where it is: **it is flying the
# chunk that helps, not predicting it.**
#
# The example is exact, and too clean: a place here is the same place in all $D$ steps of the pause, and nothing ever nudges the robot off it.
#
# ## 5.3 The same on a robot
#
# `pick_place`: take a cube off a table and let go of it in a bowl. Its expert closes the gripper and lifts after 3 steps of contact with both
# fingers, faster than any person. We also let it hold the cube for 50 steps, one second, before it lifts. Nothing else differs: the
# expert without the pause is the control. The network does not see the opening of the gripper (the default:
# a network that sees its own past decisions repeats them).
#
# Two trainings for each expert, of 80 demonstrations and 2500 steps: single actions, and chunks of 20. The second is flown in all
# three ways, the weights being the same. Everybody flies the same 80 starts, which nobody has trained on.

# %%
ROBOT, EPISODES, FLIGHTS, CHUNK = "fa_hexa_arm4", 80, 80, 20
folder = Path(tempfile.mkdtemp())
as_written = pick_place.GRIP_STEPS, pick_place.GRIP_PATIENCE_STEPS
PAUSES = {"no pause": as_written, "pause of 1 s": (50, 110)}


def quietly(function, *args, **keys):
    with contextlib.redirect_stdout(io.StringIO()):
        return function(*args, **keys)


demos, single, chunked = {}, {}, {}
for name, constants in PAUSES.items():
    pick_place.GRIP_STEPS, pick_place.GRIP_PATIENCE_STEPS = constants
    place = folder / name.replace(" ", "_")
    demos[name] = quietly(aerial_il.collect, ROBOT, "pick_place", episodes=EPISODES, seed=0, out=place)
    for length, policies in ((1, single), (CHUNK, chunked)):
        policies[name] = quietly(
            aerial_il.train, place, policy={"name": "mlp", "chunk": length}, algorithm={"steps": 2500}, run=f"{place}_{length}"
        )
    print(f"{name}: {len(demos[name])} demonstrations, {np.mean([len(e) for e in demos[name]]) * 0.02:.1f} s on average")
pick_place.GRIP_STEPS, pick_place.GRIP_PATIENCE_STEPS = as_written

# %%
env = aerial_il.load_batch(ROBOT, "pick_place", num_envs=FLIGHTS, num_threads=2)
GRASPED, LIFTED = (env.spec.subtasks.index(one) for one in ("grasped", "lifted"))


def fly(policy):
    """Flights of a policy from the seeds of the evaluation, in their order."""
    return sorted(rollouts(env, policy, range(10_000, 10_000 + FLIGHTS)), key=lambda trace: trace.seed)


def in_the_way(policy, execute, ensemble):
    """The same network, flown in another way."""
    return ChunkPolicy(replace(policy.config, execute=execute, ensemble=ensemble), policy.interface, policy.network)


flights = {}
for name in PAUSES:
    flights[name, "single"] = fly(single[name])
    for way, settings in ways_of(CHUNK).items():
        flights[name, way] = fly(in_the_way(chunked[name], *settings))
env.close()


def holding_s(trace):
    """Time from the first grasp to the first moment at which the cube is lifted; to the end, if it never is."""
    grasped, lifted = (np.flatnonzero(trace.subtasks[:, k]) for k in (GRASPED, LIFTED))
    return 0.02 * ((lifted[0] if len(lifted) else len(trace)) - grasped[0]) if len(grasped) else np.nan


print(f"{'expert':14s} {'policy':9s} {'success':>8s} {'95 % (Wilson)':>17s} {'alone / single alone':>21s} {'p':>6s} {'holds, median':>14s} {'mean time, s':>13s}")
for (name, way), traces in flights.items():
    won, other = (np.array([t.success for t in those]) for those in (traces, flights[name, "single"]))
    low, high = statistics.wilson(int(won.sum()), FLIGHTS)
    alone = int((won & ~other).sum()), int((other & ~won).sum())
    print(f"{name:14s} {way:9s} {won.sum():3d} / {FLIGHTS} {100 * low:7.1f} to {100 * high:5.1f} % "
          + (f"{alone[0]:12d} / {alone[1]:<6d} {statistics.mcnemar(*alone):6.2g}" if way != "single" else " " * 28)
          + f" {np.nanmedian([holding_s(t) for t in traces]):12.2f} s {0.02 * np.mean([len(t) for t in traces]):12.1f}")

# %%
figure, axes = plt.subplots(2, 3, figsize=(12, 5.4), sharey="row", layout="constrained")
for axis, (title, heights) in zip(axes[0], {
    "demonstrations with the pause": [e.obs["ee_pos"][:, 2] for e in demos["pause of 1 s"]][:20],
    "single actions": [t.ee_pos[:, 2] for t in flights["pause of 1 s", "single"]][:20],
    "ensemble of chunks": [t.ee_pos[:, 2] for t in flights["pause of 1 s", "ensemble"]][:20],
}.items(), strict=True):
    for height in heights:
        axis.plot(0.02 * np.arange(len(height)), height, lw=0.8, color="C0", alpha=0.6)
    axis.set(title=title, xlabel="time (s)", xlim=(0, 20))
axes[0, 0].set(ylabel="height of the tool (m)")
for axis, name in zip(axes[1], PAUSES, strict=False):
    for way in ("single", "newest", "whole", "ensemble"):
        times = np.sort([0.02 * len(t) for t in flights[name, way] if t.success])
        axis.step(np.r_[0, times, 30], 100 * np.r_[0, np.arange(1, len(times) + 1), len(times)] / FLIGHTS, where="post", label=way)
    axis.set(title=name, xlabel="time since the start (s)", xlim=(0, 30))
axes[1, 0].set(ylabel="flights that have succeeded (%)")
axes[1, 1].legend()
for name, colour in zip(PAUSES, ("C0", "C1"), strict=True):
    for k, way in enumerate(("single", "newest", "whole", "ensemble")):
        rate = sum(t.success for t in flights[name, way])
        low, high = statistics.wilson(rate, FLIGHTS)
        x = k + (0.12 if colour == "C1" else -0.12)
        axes[1, 2].errorbar(x, 100 * rate / FLIGHTS, yerr=[[100 * (rate / FLIGHTS - low)], [100 * (high - rate / FLIGHTS)]], fmt="o", capsize=4, color=colour, label=name if not k else None)
axes[1, 2].set_xticks(range(4), ["single", "newest", "whole", "ensemble"])
axes[1, 2].set(title="success with Wilson's interval", xlabel="how it flies")
axes[1, 2].legend()
plt.show()

# %% [markdown]
# How to read it. The upper row shows twenty flights each: down to the cube, up, down into the bowl, up. The table has the intervals over
# flights, and beside *single* a paired test (McNemar): how many seeds one solved and the other did not.
#
# - *Newest* has the network of *ensemble*, to the last weight. What differs between the two is how the chunk is flown. In the run shown it
#   does as *single* does, and both are slower than the two ways that fly the chunk, and solve fewer starts.
# - The trajectories of *single* show what happens: some flights stop at the cube, for seconds or for good. That is the still point of 5.2.
#   But most pass it, in the run shown with the pause about as many as without: the hovering vehicle moves by millimetres
#   even while it waits, and "go" is demonstrated from places that differ by as much. A policy that sees the present alone leaves when it
#   happens to be nudged to such a place, not when a second is over.
# - So the pause that we added explains little here: the control, an expert that hardly waits, has the same gap between deciding in every step and flying
#   chunks. Even its descent, grip and lift pass through states in which the next command jumps, and there each new decision is a new chance to stay.
# - These are **one training** of each kind on **one draw** of demonstrations. The interval does not contain what another draw
#   would change (notebook 9), so the table compares these policies, not the ideas. In particular, it is no proof that single
#   actions must fail.
# - Flying a whole chunk blindly has a price, too: for 0.4 s nothing is corrected.
#
# ## 5.4 Two ways around a pole
#
# A path of 20 points is to lead past a pole. Demonstrators start somewhere near the middle and pass it on the left or on the right, as they
# like. The whole path is one chunk; the networks are those of the project, small, each trained in seconds. The control is
# the lower row: the same, but everybody passes on the left.

# %%
POINTS, POLE_M = 20, 0.3
along = np.linspace(-1, 1, POINTS)
rng = np.random.default_rng(5)


def ways_around(n, left):
    """Starts (n, 1) and paths (n, POINTS), of which a share passes on the left."""
    start, side = rng.uniform(-0.2, 0.2, (n, 1)), np.where(rng.uniform(size=(n, 1)) < left, 1.0, -1.0)
    return start, start * (1 - along) / 2 + side * (0.6 + rng.normal(0, 0.04, (n, 1))) * np.cos(0.5 * np.pi * along) ** 2


def seen(start):
    return torch.tensor(start / 0.2, dtype=torch.float32)[:, None]


def learn(config, start, path, steps=1500):
    torch.manual_seed(0)
    network = config.build(1, 1)
    optimiser = torch.optim.AdamW(network.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    obs, actions = seen(start), torch.tensor(path / 0.5, dtype=torch.float32)[..., None]
    for _ in range(steps):
        rows = torch.randint(len(obs), (128,))
        loss, _ = network.loss(obs[rows], actions[rows], torch.ones(128, POINTS))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return network.eval()


def predict(network, start):
    drawn = (torch.randn(len(start), network.noise_size),) if network.noise_size else ()
    with torch.inference_mode():
        return 0.5 * network(seen(start), *drawn)[..., 0].numpy()


def hits(paths):
    fine = np.linspace(-1, 1, 201)
    return int(sum((np.hypot(fine, np.interp(fine, along, path)) < POLE_M).any() for path in paths))


KINDS = {
    "mlp, squares (mean)": MLP(chunk=POINTS, hidden=(128, 128), loss="l2"),
    "mlp, L1 (median)": MLP(chunk=POINTS, hidden=(128, 128), loss="l1"),
    "gmm": GMM(chunk=POINTS, hidden=(128, 128)),
    "flow": Flow(chunk=POINTS, width=128),
}
networks = {}
figure, axes = plt.subplots(2, 5, figsize=(13, 4.6), sharex=True, sharey=True, layout="constrained")
print(f"{'demonstrators':16s} {'network':20s} {'hits the pole':>14s} {'95 % (Wilson)':>15s} {'on the left':>12s}")
for row, (who, left) in enumerate({"left or right": 0.5, "all left": 1.0}.items()):
    start, path = ways_around(400, left)
    new = rng.uniform(-0.2, 0.2, (200, 1))
    axes[row, 0].plot(along, path[:80].T, color="0.5", lw=0.6)
    axes[row, 0].set(title=f"demonstrated: {who}", ylabel="sideways (m)")
    print(f"{who:16s} {'(demonstrations)':20s} {hits(path):8d} of {len(path)} {'':15s} {100 * np.mean(path[:, POINTS // 2] > 0):9.0f} %")
    for axis, (kind, config) in zip(axes[row, 1:], KINDS.items(), strict=True):
        networks[who, kind] = learn(config, start, path)
        found = predict(networks[who, kind], new)
        low, high = statistics.wilson(hits(found), len(new))
        print(f"{who:16s} {kind:20s} {hits(found):8d} of {len(new)} {100 * low:5.1f} to {100 * high:5.1f} % {100 * np.mean(found[:, POINTS // 2] > 0):9.0f} %")
        axis.plot(along, found[:80].T, lw=0.6, color="C1" if hits(found) > len(new) / 2 else "C0")
        axis.set_title(kind)
for axis in axes.flat:
    axis.add_patch(plt.Circle((0, 0), POLE_M, color="0.3"))
for axis in axes[1]:
    axis.set_xlabel("along (m)")
plt.show()

# %% [markdown]
# The mean of left and right leads **into** the pole; nobody ever demonstrated that. With everybody on the left the same network is
# fine, so it is neither too small nor badly trained: the loss asks for the mean, and gets it. The median goes with the larger half, and so
# always on one side; if the halves are equal, *anything* between them is a median, since $P(A<a)=P(A>a)$ there.
#
# **gmm** predicts several chunks $\mu_k$ with weights $\pi_k$ and deviations $\sigma_k$ and maximises the likelihood of the mixture. Its
# gradient shows why that is no mean: with $r_k=\pi_k\mathcal N_k(a)/\sum_j\pi_j\mathcal N_j(a)$, the share of the demonstration
# that mode $k$ explains,
#
# $$ \frac{\partial}{\partial\mu_k}\log\sum_j\pi_j\,\mathcal N(a;\mu_j,\sigma_j^2)=r_k\,\frac{a-\mu_k}{\sigma_k^2} . $$
#
# A demonstration pulls the mode that explains it, and leaves the others alone. In flight one mode is drawn and its mean flown.
#
# **flow** learns no action but a direction. Draw noise $\epsilon\sim\mathcal N(0,I)$, a demonstration $a$, a time $t$; the point between them is
# $x_t=(1-t)\,\epsilon+t\,a$, and the network learns the velocity $a-\epsilon$ there, by squares. So it finds a mean again:
# $v(x,t)=\mathbb E[a-\epsilon\mid x_t=x]$. But it is the mean over those that come *through x*. For any smooth $\varphi$
#
# $$ \frac{d}{dt}\mathbb E\,\varphi(x_t)=\mathbb E[\nabla\varphi(x_t)\cdot(a-\epsilon)]=\mathbb E[\nabla\varphi(x_t)\cdot v(x_t,t)] , $$
#
# which is how the points move that follow $\dot x=v(x,t)$. They start as the noise does and therefore end distributed as the
# demonstrations are (Lipman et al. 2023). Below, the middle of the path on its way from noise to action:

# %%
network, draws, euler = networks["left or right", "flow"], 60, 40
torch.manual_seed(1)
with torch.inference_mode():
    x, obs = torch.randn(draws, POINTS), torch.zeros(draws, 1)
    places = [x[:, POINTS // 2]]
    for k in range(euler):
        x = x + network.denoiser(x, torch.full((1, 1), k / euler), network.denoiser.see(obs)) / euler
        places.append(x[:, POINTS // 2])
lines = 0.5 * torch.stack(places).numpy()
figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
axes.plot(np.linspace(0, 1, euler + 1), lines, lw=0.8, color="C0")
axes.axhspan(-POLE_M, POLE_M, xmin=0.955, color="0.3")
axes.set(xlabel="time of the flow: 0 noise, 1 action", ylabel="sideways, at the pole (m)", title="sixty draws for one start", xlim=(0, 1.05))
plt.show()
print("left", int((lines[-1] > 0).sum()), "right", int((lines[-1] < 0).sum()), "of", draws)

# %% [markdown]
# The lines are drawn towards the middle at first, where the mean is, and part on the way (they may cross: each is one of twenty coordinates). A draw that is undecided for long may end between
# the modes: the table above counts such paths, and [the page on policies](../docs/policies.md) says what is known to fail for each network.
#
# With few demonstrations neither chunks nor mixtures help: the policy comes to places that nobody has shown. Notebook 6 is about that.
#
# **Sources.** Pomerleau, *NeurIPS* 1988 (cloning a driver). Zhao et al., "Learning fine-grained bimanual manipulation with low-cost
# hardware", *RSS* 2023 (chunks, temporal ensembles). Bishop, "Mixture density networks", 1994. Lipman et al., "Flow matching for
# generative modeling", *ICLR* 2023. Mandlekar et al., "What matters in learning from offline human demonstrations", *CoRL* 2021.
