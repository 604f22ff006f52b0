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
# # 9. Reading a study: intervals, seeds, comparisons
#
# "Our policy succeeds in 90 % of flights, the baseline in 80 %." Is it better? That depends on how many flights
# were flown, whether both flew the same ones, how many times each was trained, and how the checkpoint was chosen.
# This notebook answers by simulation: policies whose true success we *know*, judged as studies judge theirs.
# Nothing here flies, so thousands of studies take seconds.

# %%
import matplotlib.pyplot as plt
import numpy as np

from aerial_il.presentation import analysis
from aerial_il.evaluation import statistics

analysis.use_style()
rng = np.random.default_rng(9)

# %% [markdown]
# ## 1. A success rate is an estimate
#
# Each flight succeeds with an unknown probability $p$. Of $n$ flights $k$ succeed, and $\hat p = k/n$ is our guess.
# The textbook interval $\hat p \pm 1.96\sqrt{\hat p(1-\hat p)/n}$ takes the deviation at $\hat p$, and has **no
# width** at $k = n$: "20 of 20" would mean exactly 100 %. Wilson (1927) asks instead which $p$ would not be surprised
# by what was seen, $|\hat p - p| \le z\sqrt{p(1-p)/n}$, and solves for $p$:
#
# $$p \in \frac{\hat p + \frac{z^2}{2n} \pm z\sqrt{\frac{\hat p(1-\hat p)}{n} + \frac{z^2}{4n^2}}}{1 + z^2/n},
# \qquad z = 1.96 .$$
#
# How often does either cover the truth? An honest 95 % interval does so in 95 % of studies.

# %%
n, studies = 50, 4000
truths = np.linspace(0.02, 0.98, 49)
covered = {"textbook": [], "Wilson": []}
wilson = np.array([statistics.wilson(k, n) for k in range(n + 1)])
for truth in truths:
    k = rng.binomial(n, truth, studies)
    half = 1.96 * np.sqrt(k / n * (1 - k / n) / n)
    covered["textbook"].append(np.mean(np.abs(k / n - truth) <= half))
    covered["Wilson"].append(np.mean((wilson[k, 0] <= truth) & (truth <= wilson[k, 1])))
figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), layout="constrained")
for name, style in (("textbook", "--"), ("Wilson", "-")):
    left.plot(100 * truths, 100 * np.array(covered[name]), style, label=name)
left.axhline(95, color="0.4", lw=1)
left.set(xlabel="true success (%)", ylabel="intervals that hold it (%)", ylim=(50, 101), title=f"{n} flights, {studies} studies each")
left.legend()
for rate in (0.5, 0.8, 0.95):
    counts = np.array([10, 20, 50, 100, 200, 500, 1000])
    ends = np.array([statistics.wilson(round(rate * m), m) for m in counts])
    right.plot(counts, 100 * (ends[:, 1] - ends[:, 0]) / 2, marker="o", label=f"{100 * rate:.0f} % seen")
right.set(xscale="log", xlabel="flights", ylabel="half width (points)", title="how sure so many flights make")
right.legend()
plt.show()
for k, m in ((10, 10), (45, 50), (90, 100), (270, 300)):
    low, high = statistics.wilson(k, m)
    print(f"{k:3d} of {m:3d}: {100 * k / m:.0f} %, interval {100 * low:.1f} to {100 * high:.1f} %")

# %% [markdown]
# The textbook interval fails where good policies live, near 100 %. And the right panel is the price list: to halve
# an interval takes four times the flights. Ten flights tell a 90 % policy from a 40 % one, and little else.
#
# ## 2. Two policies: fly the same seeds
#
# A seed fixes the start, the target and the wind. Some seeds are easy for everybody. If both policies fly the *same*
# seeds, that luck cancels: only the seeds matter on which exactly one succeeded ($b$ won by the one alone, $c$ by the
# other). If the policies are equal, each of these is a coin toss, so $b \sim \mathrm{Binomial}(b + c, 1/2)$: McNemar's
# test (1947), made exact. For flights on different seeds there is Fisher's exact test (1922).
#
# Below, seeds differ in difficulty, and policy B's chance is 10 or 20 points higher on each, up to certainty.

# %%
def flights(better: float, n: int, paired: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return (n,) successes of A and of B; a seed's difficulty moves both, one luck of the flight is each one's own."""
    easy_a = np.clip(rng.beta(1.2, 0.5, n), 0, 1)
    easy_b = easy_a if paired else rng.beta(1.2, 0.5, n)
    return rng.random(n) < easy_a, rng.random(n) < np.clip(easy_b + better, 0, 1)

def found(better: float, n: int, paired: bool, studies: int = 400) -> float:
    """Return the share of studies that call the difference significant at 5 %."""
    hits = 0
    for _ in range(studies):
        a, b = flights(better, n, paired)
        p = statistics.mcnemar(int((a & ~b).sum()), int((b & ~a).sum())) if paired else statistics.fisher(a.sum(), n, b.sum(), n)
        hits += p < 0.05
    return hits / studies

counts = (25, 50, 100, 200, 400)
figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
for hue, better in enumerate((0.0, 0.1, 0.2)):
    for paired, style in ((True, "-"), (False, "--")):
        power = [100 * found(better, n, paired) for n in counts]
        axes.plot(counts, power, style, color=f"C{hue}", marker="o", label=f"+{100 * better:.0f} points, {'same seeds' if paired else 'other seeds'}")
axes.axhline(5, color="0.4", lw=1)
axes.set(xscale="log", xlabel="flights of each policy", ylabel="studies that find it (%)", title="p < 0.05, 400 studies a point")
axes.set_xticks(counts, counts)
axes.minorticks_off()
axes.legend(fontsize=8)
plt.show()

# %% [markdown]
# The flat lines at the bottom are right: where there is no difference, at most about 5 % of studies claim one (the grey line).
# The same seeds find a difference with fewer flights. `aerial-il compare A B` does this by itself: paired where the seeds
# agree, and it says which test it used.
#
# ## 3. One training is one draw
#
# Train again, with another seed or other demonstrations, and the success changes by more than flights explain. The
# interval over flights of *one* policy says nothing about that. Let trainings scatter with a deviation of 8 points around
# 80 %, and let a study compare two methods that are **equal**.

# %%
def method(trainings: int, flown: int) -> np.ndarray:
    """Return (trainings,) success rates of one method, 80 % on average over trainings."""
    return rng.binomial(flown, np.clip(rng.normal(0.80, 0.08, trainings), 0, 1)) / flown

wrong = {}
for trainings in (1, 3, 5, 10):
    naive = student = 0
    for _ in range(2000):
        a, b = method(trainings, 300), method(trainings, 300)
        pooled = [round(300 * one.sum()) for one in (a, b)]
        low, high = statistics.newcombe(pooled[0], 300 * trainings, pooled[1], 300 * trainings)
        naive += not low <= 0 <= high
        if trainings > 1:
            spread = np.sqrt(a.var(ddof=1) / trainings + b.var(ddof=1) / trainings)
            from scipy.stats import t
            student += abs(a.mean() - b.mean()) > t.ppf(0.975, 2 * trainings - 2) * spread
    wrong[trainings] = naive / 2000, student / 2000
    print(f"{trainings:2d} trainings: flights pooled {100 * naive / 2000:.0f} % wrong, over trainings "
          + (f"{100 * student / 2000:.0f} %" if trainings > 1 else "cannot be told"))

# %%
figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
places = np.arange(len(wrong))
axes.bar(places - 0.2, [100 * w for w, _ in wrong.values()], 0.4, label="interval over flights")
axes.bar(places + 0.2, [100 * w for _, w in wrong.values()], 0.4, label="interval over trainings (Student)")
axes.axhline(5, color="0.4", lw=1)
axes.set_xticks(places, [f"{n}" for n in wrong])
axes.set(xlabel="trainings of each method, 300 flights each", ylabel="wrong claims (%)", title="two equal methods called different", ylim=(0, 80))
axes.legend(ncols=2)
plt.show()

# %% [markdown]
# More trainings do not help who pools their flights: the interval shrinks as fast as the scatter, and was too narrow from the start.
# So the tables of this project give two intervals: over flights (Wilson), and over trainings (Student's, `t_interval`). With
# three trainings the second is wide, and that is the truth. Many numbers tested at once need a correction too (Holm 1979).
#
# ## 4. The best of many checkpoints
#
# "We report the best checkpoint." Take a policy that does **not** improve at all: each of its checkpoints truly succeeds
# in 80 %. Each is flown 20 times on the way, and the best is reported.

# %%
best = {m: rng.binomial(20, 0.8, (20_000, m)).max(axis=1) / 20 for m in (1, 2, 5, 10, 20, 50)}
figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
axes.plot(list(best), [100 * b.mean() for b in best.values()], marker="o")
axes.fill_between(list(best), *[[100 * np.quantile(b, q) for b in best.values()] for q in (0.025, 0.975)], alpha=0.15)
axes.axhline(80, color="0.4", lw=1)
axes.text(20, 80.7, "the truth", color="0.3")
axes.set(xscale="log", xlabel="checkpoints among which the best is chosen", ylabel="success reported (%)", title="20 flights each; band: 95 % of 20,000 studies")
axes.set_xticks(list(best), list(best))
axes.minorticks_off()
plt.show()
print({m: f"{100 * b.mean():.1f} %" for m, b in best.items()})

# %% [markdown]
# The cure costs nothing: choose on some seeds, **judge on others**. Here settings and checkpoints are chosen on seeds
# 5000 to 5999, and rollouts on the way refuse seeds from 10000 on, which judge the finished policy.
#
# ## A list for reading a study, ours included
#
# 1. How many flights, and the interval? 2. How many trainings, with other demonstrations? 3. Same seeds for both, and a
# test that knows it? 4. Was the checkpoint chosen on the flights that judge it? 5. What did the baseline get: as many
# demonstrations, as many steps, as much tuning? 6. How many comparisons were made before this one was shown?
#
# **Sources.** Wilson, JASA 1927, eq. 8. McNemar, Psychometrika 1947. Newcombe, Statistics in Medicine 1998, method 10. Holm, Scand. J.
# Statistics 1979. Agarwal et al., "Deep RL at the edge of the statistical precipice", NeurIPS 2021. Everything random here
# is drawn from one generator, so the numbers repeat.
