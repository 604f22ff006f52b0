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
# # 11. Analysing your own runs
#
# After a week of training there are forty folders. `aerial_il.presentation.analysis` reads them as pandas data frames and draws the figures of the
# report: runs, what they logged, evaluations, recordings. This notebook makes a few small runs of three kinds, cloning, DAgger and
# reinforcement learning, and then only reads. To look at runs of your own, leave out the next section and set `runs` to your folder.
#
# | file of a run | read by | one row is |
# |---|---|---|
# | `config.yaml` and the rest | `analysis.runs(folder)` | a run |
# | `metrics.jsonl` | `analysis.metrics(run)` | a line that was logged |
# | `evaluation.json` | `analysis.evaluation(folder)` | a flight |
# | recordings, datasets of others | `analysis.dataset(folder)`, `analysis.steps(folder)` | an episode, a control step |

# %%
import contextlib
import io
import os
import tempfile
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import aerial_il
from aerial_il.presentation import analysis
from aerial_il.evaluation import statistics

analysis.use_style()
os.chdir(tempfile.mkdtemp())  # the notebook leaves nothing behind
runs = Path("runs")

# %% [markdown]
# ## 1. Some runs
#
# `reach` with `fa_hexa_arm4`: the expert flies 40 demonstrations, slightly disturbed. Clones of 8 of them and of all 40, with two seeds
# each; DAgger, which begins with the 8. And PPO on CartPole with two seeds, which learns from reward in an environment that is not ours.
# All are much smaller than anything worth reporting.

# %%
CLONE = {"policy": {"name": "mlp", "chunk": 10, "hidden": [128, 128]}, "evaluate_episodes": 20}
with contextlib.redirect_stdout(io.StringIO()):
    aerial_il.collect("fa_hexa_arm4", "reach", episodes=40, expert={"noise": 0.1}, out="datasets/reach")
    for name, episodes in (("few", 8), ("many", 40)):
        for seed in (0, 1):
            aerial_il.train(
                {"path": "datasets/reach", "episodes": episodes}, algorithm={"steps": 600, "validate_every": 100}, evaluate_every=200,
                run=runs / name / f"seed={seed}", seed=seed, **CLONE,
            )  # fmt: skip
    aerial_il.train(
        {"path": "datasets/reach", "episodes": 8}, run=runs / "dagger", **CLONE,
        algorithm={"name": "dagger", "rounds": 3, "episodes": 8, "between_steps": 300, "training": {"steps": 600}},
    )  # fmt: skip

# %%
with contextlib.redirect_stdout(io.StringIO()):
    for seed in (0, 1):
        aerial_il.train(
            algorithm={"name": "ppo", "steps": 6000, "rollout": {"steps": 1024}, "cadence": {"log_every": 1000}}, policy="categorical",
            env="gymnasium:CartPole-v1", threads=1, run=runs / "ppo" / f"seed={seed}", seed=seed,
        )  # fmt: skip
(runs / "stopped").mkdir()
(runs / "stopped" / "config.yaml").touch()  # a run that was killed before its first step

# %% [markdown]
# ## 2. Which runs are there?
#
# One row for each run, whatever its algorithm. What is no run, or only half of one, is named in a warning and stops nothing.

# %%
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    table = analysis.runs(runs)
for one in told:
    print(one.message)
columns = ["run", "algorithm", "environment", "task", "seed", "episodes", "steps", "unit", "flown", "success", "low", "high", "flights"]
table[columns].round(2)

# %% [markdown]
# - `steps` counts what the algorithm counts, see `unit`: steps of the optimiser, rounds, or steps in the environment. `flown` is what a
#   robot would have had to fly for it, in control steps of 20 ms: nothing for a clone.
# - `success` is that of the last rollouts on the way, with Wilson's interval. Those are flown on the seeds from 5000 on and are for
#   choosing and for finding mistakes. They do not judge: section 4 does.
# - Missing is missing: PPO here had no rollouts on the way, and CartPole knows no success.
#
# From here on it is pandas. For example, the mean over seeds:

# %%
table["setting"] = table["run"].str.split("/").str[0]
table.groupby("setting").agg(runs=("run", "size"), success=("success", "mean"), worst=("success", "min"), flown=("flown", "mean")).round(2)

# %% [markdown]
# ## 3. What did they log?
#
# `metrics` returns the lines of `metrics.jsonl`. Rollouts have lines of their own, so that a column has gaps: `dropna` before you plot.

# %%
logged = analysis.metrics(runs / "many" / "seed=0")
print(", ".join(logged.columns[:8]), "...")
losses = logged[["step", "loss", "validation/loss"]].dropna(how="all", subset=["loss", "validation/loss"]).set_index("step")
axes = losses.plot(logy=True, figsize=(6.4, 3), marker="o", ms=3, xlabel="training step", ylabel="loss")
plt.show()

# %% [markdown]
# A loss says whether the optimiser works, and the gap between the two curves whether it learns by heart. Which policy flies better it
# does not say. The rollouts on the way do, as far as 20 flights can. `learning_curves` takes several runs under one label and gives the
# interval of their mean; thin lines are single runs.

# %%
analysis.learning_curves({name: sorted((runs / name).glob("seed=*")) for name in ("few", "many")})

# %% [markdown]
# DAgger counts rounds, so it does not belong on that axis. What would be a fair one? An expert's time, for instance: how many states had
# to be labelled. `curves` draws any logged number over any other. A clone has all its demonstrations from the start, so each setting of
# the clones is one point.

# %%
figure = analysis.curves({"dagger": [runs / "dagger"]}, "evaluate/success", over="total/labelled_steps")
axes, demos = figure.axes[0], analysis.dataset("datasets/reach")
for hue, (name, episodes) in enumerate((("few", 8), ("many", 40)), start=1):
    mean, cost = table.loc[table["setting"] == name, "success"].mean(), demos["steps"][:episodes].sum()
    axes.plot([cost], [mean], "s", color=f"C{hue}", label=f"clones of {episodes} ({cost} steps), mean of two")
axes.set(ylim=(-0.05, 1.05), xlabel="states with an expert's action")
axes.legend(loc="lower right")
figure

# %% [markdown]
# One DAgger run, a few rounds, 20 flights a point: a picture of how to look, not of what DAgger is worth. Notebook 9 says what a
# comparison takes, `experiments/dagger` made one.
#
# For reinforcement learning the number of interest is the return of the episodes that it flies while learning. The band is from the
# worse of the two seeds to the better.

# %%
analysis.curves({"ppo": sorted((runs / "ppo").glob("seed=*"))}, "episode/return")

# %% [markdown]
# ## 4. How good are the finished policies?
#
# Each is judged by the same 50 flights, on seeds from 10000 on, which nobody has used. `evaluation` returns one row per flight.

# %%
judged = {"few": runs / "few" / "seed=0", "many": runs / "many" / "seed=0", "dagger": runs / "dagger"}
with contextlib.redirect_stdout(io.StringIO()):
    for name, run in judged.items():
        aerial_il.evaluate(run, episodes=50, seed=10_000, videos=0, out=run / "calm")
    for seed in (0, 1):
        run = runs / "ppo" / f"seed={seed}"
        aerial_il.evaluate(run, episodes=50, seed=10_000, videos=0, out=run / "judged")
flights = pd.concat({name: analysis.evaluation(run / "calm").drop(columns="policy") for name, run in judged.items()}, names=["policy", None])
flights.groupby("policy", sort=False).agg(
    flights=("seed", "size"), succeeded=("success", "sum"), median_s=("time_to_success_s", "median"),
    mean_reward=("mean_reward", "mean"), jerk=("action_jerk_rms.m/s^3", "median"), effort=("effort_mean", "mean"),
).round(3)  # fmt: skip

# %%
analysis.success({name: run / "calm" for name, run in judged.items()})

# %% [markdown]
# When does a flight succeed? `survival` draws the share that has succeeded by each moment. What never succeeds never leaves the bottom,
# so a policy cannot look fast by giving up on the hard starts, as it can in a mean time to success.

# %%
analysis.survival({name: run / "calm" for name, run in judged.items()})

# %% [markdown]
# A seed fixes the start, so flights of several policies can be laid side by side. Which starts does nobody solve, which only one? Those
# are the flights to look at, with `aerial-il replay` or on the pages of `aerial-il report`.

# %%
beside = flights.reset_index("policy").pivot(index="seed", columns="policy", values="success")[list(judged)].astype(bool)
print(beside.value_counts().rename("starts").to_string())
print("nobody solved seeds", beside.index[~beside.any(axis=1)][:8].tolist())

# %% [markdown]
# ## 5. Is one better than the other?
#
# `compare` gives the difference of every number with its 95 % interval and p-value. Both flew the same seeds, so the comparison is paired:
# McNemar's test for success, permutation of signs for the rest. Many numbers are tested at once; `p_adjusted` is Holm's correction for
# that. A p-value of 0.0002 is the smallest that the permutations can show. (A success ends the flight here. So a policy that succeeds
# may collect a smaller return than one that hovers nearby to the end; `mean_reward` does not have that flaw.)

# %%
found = analysis.compare(judged["few"] / "calm", judged["dagger"] / "calm")
print(f"paired: {found.attrs['paired']}, {found.attrs['method']}; solved by a alone {len(found.attrs['only_a'])}, by b alone {len(found.attrs['only_b'])}")
shown = found.drop(columns="label").round(3)
shown[["p_value", "p_adjusted"]] = found[["p_value", "p_adjusted"]].map("{:.2g}".format)
shown

# %%
analysis.paired_comparison(judged["few"] / "calm", judged["dagger"] / "calm")

# %% [markdown]
# An interval that holds 0 does not say that both are equal; it says that these flights cannot tell. Nor does an interval far from 0 say
# that DAgger is better than cloning: it compares *these two policies*, each one training. DAgger also had more labelled states, which
# the figure of section 3 counts.
#
# In an environment without success the return is the question. Two seeds of one setting differ, too:

# %%
analysis.returns({f"seed {seed}": runs / "ppo" / f"seed={seed}" / "judged" for seed in (0, 1)})

# %%
found = analysis.compare(runs / "ppo" / "seed=0" / "judged", runs / "ppo" / "seed=1" / "judged")
print(found.loc["return", ["a", "b", "difference", "low", "high", "p_value"]].astype(float).round(3).to_string())
means = [analysis.evaluation(runs / "ppo" / f"seed={seed}" / "judged")["return"].mean() for seed in (0, 1)]
print("mean of the two trainings", round(sum(means) / 2, 1), "; interval over trainings", [round(float(end), 1) for end in statistics.t_interval(pd.Series(means).to_numpy())])

# %% [markdown]
# The interval over flights says how well we know each policy. The last line says how well two trainings tell what the *setting* is
# worth: hardly. Train at least three, better five (notebook 9).
#
# ## 6. What was recorded?
#
# `dataset` has one row per episode. DAgger keeps what it flew in `dataset/` of its run, so one can see where the expert took over.

# %%
demos, flown = analysis.dataset("datasets/reach"), analysis.dataset(runs / "dagger" / "dataset")
own = flown[~flown["uid"].isin(demos["uid"])].sort_values("seed")  # seeds grow from round to round
figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.2), layout="constrained")
left.hist([demos["duration_s"], own["duration_s"]], bins=15, label=[f"{len(demos)} demonstrations", f"{len(own)} flights of DAgger"])
left.set(xlabel="duration (s)", ylabel="episodes", title="how long they took")
left.legend()
right.bar(range(len(own)), 100 * own["interventions"], color=["C2" if won else "C1" for won in own["success"]])
right.set(xlabel="flight of DAgger, in order", ylabel="steps flown by the expert (%)", title="green: it succeeded")
plt.show()
demos[["steps", "duration_s", "return"]].describe().loc[["mean", "std", "min", "max"]].round(2)

# %% [markdown]
# `steps` has one row per control step: time, reward, phase, each element of the observation and of the action. How near does the tool
# come, in demonstrations and in DAgger's flights?

# %%
def distances(folder, episodes):
    """One column of distances (m) for each episode."""
    chosen = [analysis.steps(folder, episode, failures=True).set_index("time_s") for episode in episodes]
    apart = [sum((one[f"ee_pos[{k}]"] - one[f"target_pos[{k}]"]) ** 2 for k in range(3)) ** 0.5 for one in chosen]
    return pd.concat(apart, axis=1)


figure, axes = plt.subplots(1, 2, figsize=(9.5, 3.2), sharey=True, layout="constrained")
distances("datasets/reach", range(8)).plot(ax=axes[0], legend=False, title="8 demonstrations")
distances(runs / "dagger" / "dataset", own["uid"][:8]).plot(ax=axes[1], legend=False, title="the first 8 flights of DAgger")
for one in axes:
    one.axhline(0.02, color="0.4", lw=1)
    one.set(xlabel="time (s)", ylabel="tool to target (m)", yscale="log")
plt.show()

# %% [markdown]
# The grey line is the tolerance of `reach`, 2 cm.
#
# ## The same without Python
#
# `aerial-il report RUN` writes the page of a run or of a sweep, `aerial-il compare A B` prints section 5, `aerial-il runs` lists what section
# 2 lists. Frames go anywhere else: `table.to_csv("runs.csv")`, `flights.to_parquet(...)`, R, a spreadsheet.
