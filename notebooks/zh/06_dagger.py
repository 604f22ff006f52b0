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
# # 6. 分布偏移与 DAgger
#
# 克隆策略在专家的状态上训练，却在自己的状态上飞行。一个小误差把它带偏一点，到达任何示范都没有出现过的状态；在那里误差更大，于是偏得更远。普通的监督学习没有这个问题，因为在那里，回答不会决定下一道题是什么。本篇先用最小的例子展示这种效应，再在一台把销钉插入孔中的机器人上测量它，最后尝试经典的补救办法 DAgger，并与这类方法都应该面对的对照相比较。不运行代码也能读完全篇。

# %%
import contextlib
import io
import os
import tempfile

import matplotlib.pyplot as plt
import numpy as np
import torch
from IPython.display import Image as Film
from PIL import Image

import aerial_il
from aerial_il.presentation import analysis
from aerial_il.core.rendering import can_render
from aerial_il.evaluation import statistics
from aerial_il.presentation.films.scene_renderer import SceneRenderer

analysis.use_style()
torch.set_num_threads(1)
os.chdir(tempfile.mkdtemp())  # the notebook leaves nothing behind

# %% [markdown]
# ## 6.1 误差为什么会按平方累积
#
# 一条 $T$ 步长的钢丝。每一步，学习者*在专家的状态上*（也就是在钢丝上）以概率 $\epsilon$ 出错。在钢丝之外的每一步代价为 1。示范从未离开过钢丝，所以没有学到在钢丝之外该怎么办：一旦出错，就再也回不来。$t$ 步之后不在钢丝上的概率为 $1-(1-\epsilon)^t\le\epsilon t$，期望代价为
#
# $$ J=\sum_{t=1}^{T}\big(1-(1-\epsilon)^t\big)\;\le\;\epsilon\,\frac{T(T+1)}{2}, $$
#
# 与 $T$ 的**平方**成正比。任何克隆策略都不会比这更差，这是 Ross 与 Bagnell（2010）的定理 2.1：如果代价在 $[0,1]$ 之内，*在专家的状态上*的误差为 $\epsilon$，则 $J(\hat\pi)\le J(\pi^*)+T^2\epsilon$。
#
# 现在设学习者是在它自己到达的状态上训练的，包括钢丝之外的状态，并且在那里出错也不更频繁：出错之后，它以概率 $1-\epsilon$ 走回来。于是它不在钢丝上的步数占 $\epsilon$，$J=\epsilon T$：**线性**。一般的结论（Ross、Gordon 与 Bagnell 2011，定理 2.2）是：如果*在学习者自己的状态上*的误差为 $\epsilon$，而一个错误动作使此后的总代价最多增加 $u$，则 $J(\hat\pi)\le J(\pi^*)+u\,T\epsilon$。

# %%
EPSILON, WALKERS = 0.02, 4000
rng = np.random.default_rng(6)
horizons = np.arange(1, 201)


def costs(back):
    """Mean cost up to each horizon; who is off the rope returns with probability `back` in a step."""
    off, spent = np.zeros(WALKERS, bool), []
    for _ in horizons:
        off = np.where(off, rng.random(WALKERS) >= back, rng.random(WALKERS) < EPSILON)
        spent.append(off.mean())
    return np.cumsum(spent)


figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
axes.plot(horizons, costs(0.0), lw=4, alpha=0.4, label="never learned to step back")
axes.plot(horizons, np.cumsum(1 - (1 - EPSILON) ** horizons), color="C0", lw=1, label="its exact mean")
axes.plot(horizons, EPSILON * horizons * (horizons + 1) / 2, "--", color="0.5", label=r"bound $\epsilon T(T+1)/2$")
axes.plot(horizons, costs(1 - EPSILON), lw=4, alpha=0.4, color="C1", label="steps back")
axes.plot(horizons, EPSILON * horizons, color="C1", lw=1, label=r"$\epsilon T$")
axes.set(xlabel="length of the rope T", ylabel="expected steps beside it", ylim=(0, 200), title=f"error rate {EPSILON}, mean of {WALKERS} walkers")
axes.legend()
plt.show()

# %% [markdown]
# 两个学习者的训练误差相同。用留出的示范做测试无法区分它们：这样的测试只在钢丝上提问。
#
# ## 6.2 在机器人上
#
# `insert_peg`，机器人 `fa_hexa_arm4`：从座上取下销钉，插入孔中。脚本专家给出二十次示范，每次四秒，并据此训练一个小的克隆策略。然后从同样的 60 个起始状态飞行（没有任何训练用过它们），共两种：
#
# - 专家飞行，每一步询问克隆策略*会*怎么做；
# - 克隆策略飞行，每一步询问专家。
#
# 两种情形下二者之差都是克隆策略的误差，一种在专家的状态上，一种在它自己的状态上。飞行在成功、坠毁或 10 秒之后结束（任务本身允许 40 秒；示范大约需要 4 秒）。

# %%
ROBOT, TASK, DEMOS, FLIGHTS, LIMIT = "fa_hexa_arm4", "insert_peg", 20, 60, 500
POLICY = {"name": "mlp", "hidden": [128, 128]}
STEPS, ROUNDS, PER_ROUND, BETWEEN = 2500, 3, 10, 500


def quietly(function, *args, **keys):
    with contextlib.redirect_stdout(io.StringIO()):
        return function(*args, **keys)


demos = quietly(aerial_il.collect, ROBOT, TASK, episodes=DEMOS, seed=0, out="demos", progress=False)
clone = quietly(aerial_il.train, "demos", policy=POLICY, algorithm={"steps": STEPS}, run="clone")
print(len(demos), "demonstrations,", sum(map(len, demos)), "steps")

# %%
env = aerial_il.load_batch(ROBOT, TASK, num_envs=FLIGHTS, num_threads=2)
expert = aerial_il.expert(ROBOT, TASK)
SEEDS = np.arange(10_000, 10_000 + FLIGHTS)
FIELDS = tuple(field.name for field in env.spec.observation.fields)


def fly(pilot, asked=None):
    """Fly all starts; at each step `asked` says what it would do. Arrays (T, n, ...), NaN after the end of a flight."""
    obs = env.reset(SEEDS)
    for one in (pilot, asked):
        if hasattr(one, "attach"):
            one.attach(env)
        if one is not None:
            one.reset()
    flying, won = np.ones(FLIGHTS, bool), np.zeros(FLIGHTS, bool)
    kept = {"seen": [], "apart_cm": [], "states": [], "flying": []}
    for _ in range(LIMIT):
        kept["seen"].append(np.where(flying[:, None], env.spec.observation.flatten(obs, FIELDS), np.nan))
        kept["states"].append(env.get_state())
        kept["flying"].append(flying)
        actions = pilot.act(obs)
        if asked is not None:
            apart = 100 * np.linalg.norm((asked.act(obs) - actions)[:, :3], axis=1)
            kept["apart_cm"].append(np.where(flying, apart, np.nan))
        result = env.step(actions, flying)
        obs, won = result.obs, won | (flying & result.info["success"])
        flying = flying & ~(result.info["success"] | result.terminated | result.truncated)
        if not flying.any():
            break
    return {name: np.array(values) for name, values in kept.items() if values} | {"won": won}


flown = {"expert": fly(expert, asked=clone), "clone": fly(clone, asked=expert)}


def told(name):
    won = flown[name]["won"]
    low, high = statistics.wilson(int(won.sum()), FLIGHTS)
    return f"{name:22s} {won.sum():3d} of {FLIGHTS} within {0.02 * LIMIT:.0f} s   95 % (Wilson): {100 * low:5.1f} to {100 * high:5.1f} %"


print(told("expert"), told("clone"), sep="\n")

# %% [markdown]
# 这些飞行离示范有多远？每个观测（不含速度与力）按它在示范中的标准差缩放；度量是到最近的示范观测的距离，按每个元素计。专家的新飞行也有新的起始状态，所以它们就是尺度：超出它们的部分就是偏移。

# %%
STILL = tuple(name for name in FIELDS if not name.endswith(("vel", "force")))
columns = np.concatenate([np.full(field.size, field.name in STILL) for field in env.spec.observation.fields])
shown_states = np.concatenate([episode.flat_obs(FIELDS) for episode in demos])[:, columns]
spread = shown_states.std(axis=0).clip(0.01)
known = torch.tensor(shown_states / spread, dtype=torch.float32)


def away(flight, every=5):
    """(T / every, n) distance of each state to the nearest demonstrated one, in deviations per element."""
    seen = torch.tensor(flight["seen"][::every][..., columns] / spread, dtype=torch.float32)
    return torch.stack([torch.cdist(moment, known).min(dim=1).values for moment in seen]).numpy() / np.sqrt(columns.sum())


def band(axis, values, label, colour, every=1):
    """Median, and from the 10th to the 90th percentile, of the flights that are still in the air, where there are ten."""
    enough = np.isfinite(values).sum(axis=1) >= 10
    low, middle, high = np.nanpercentile(values[enough], (10, 50, 90), axis=1)
    time_s = 0.02 * every * np.arange(len(values))[enough]
    axis.plot(time_s, middle, color=colour, label=label)
    axis.fill_between(time_s, low, high, color=colour, alpha=0.2, lw=0)


end, peg = (slice(*np.cumsum([0, *(f.size for f in env.spec.observation.fields)])[FIELDS.index(n) + np.array([0, 1])]) for n in ("end_to_hole", "peg_axis"))
figure, axes = plt.subplots(1, 4, figsize=(14, 3.3), layout="constrained")
for axis, (name, colour) in zip(axes, {"expert": "C0", "clone": "C1"}.items(), strict=False):
    path = flown[name]["seen"][:, :, end]
    axis.plot(100 * np.linalg.norm(path[..., :2], axis=2), -100 * path[..., 2], lw=0.5, color=colour)
    axis.set(xlabel="peg's end beside the hole (cm)", ylabel="above it (cm)", title=f"{FLIGHTS} flights of the {name}", xlim=(-1, 45), ylim=(-8, 10))
for name, colour in {"expert": "C0", "clone": "C1"}.items():
    band(axes[2], away(flown[name]), f"the {name} flies", colour, every=5)
    band(axes[3], flown[name]["apart_cm"], f"on states of the {name}", colour)
axes[2].set(xlabel="time (s)", ylabel="deviations per element", title="distance to what was shown", xlim=(0, 8), yscale="log")
axes[3].set(xlabel="time (s)", ylabel="cm", title="clone's command less expert's", xlim=(0, 8))
for axis in axes[2:]:
    axis.legend()
plt.show()
for name in ("expert", "clone"):
    late = flown[name]["apart_cm"]
    print(f"on states of the {name:7s}: mean difference {np.nanmean(late):5.2f} cm, in the first second {np.nanmean(late[:50]):5.2f}, after 4 s {np.nanmean(late[200:]):5.2f}")

# %% [markdown]
# 怎样解读。左边两幅图是销钉下端相对于孔的位置：专家把它提起，在孔口上方五厘米处移过去，再放下。克隆策略的许多飞行在途中掉了高度，于是销钉碰到地面、掉落，或者落在孔的旁边。第三幅图不需要了解任务就能说明同一件事：克隆策略的飞行离开了示范到过的地方，而且不再回来（色带：*仍在空中*的飞行的中间 80 %，所以 4 s 之后其中不再有成功的飞行；躺倒的销钉在二十个标准差之外，因为在示范中它从来没有躺倒过）。最后一幅是本篇的要点：**同一个网络**，一次在专家的状态上提问，一次在它自己的状态上提问。在前者上，平均误差从头到尾都是 2 至 3 cm，而留出的示范能显示的也只有这个。
#
# （一点保留。脚本专家记着自己所处的阶段。别人飞行时它只是旁观，可能以为自己已经进行到更靠后的阶段，所以右图的差异有一部分是它的，而不是克隆策略的：[关于这些标签已知的情况](../../docs/dagger.md#classic-dagger)。）
#
# ## 6.3 DAgger：在学习者的状态上提问
#
# *数据集聚合*（Ross、Gordon 与 Bagnell 2011，算法 3.1）。第 $i$ 轮由混合策略飞行，
#
# $$ \pi_i=\beta_i\,\pi^*+(1-\beta_i)\,\hat\pi_i,\qquad \mathcal D\leftarrow\mathcal D\cup\{(s,\pi^*(s)) : s\ \text{是}\ \pi_i\ \text{到达的状态}\},\qquad
# \hat\pi_{i+1}=\mathcal D\ \text{的克隆}, $$
#
# 无论是谁飞到那里，专家都给所到达的每个状态标注，下一个学习者是迄今全部数据的克隆。各轮合起来是一个在线学习问题：每一轮由对手（学习者自己的飞行）选择状态，而克隆*迄今的全部数据*就是"跟随领先者"。它平均每轮的遗憾趋于零，因此轮数足够多之后，某个 $\hat\pi_i$ 在*它自己*到达的状态上误差很小，而这正是 6.1 中线性界所要求的（论文的定理 3.2）。
#
# 这里：三轮，每轮十次飞行，专家的份额 $\beta_i=0.7^i$ 逐轮下降。项目的默认设置与论文有三处不同，理由见[说明](../../docs/dagger.md#classic-dagger)：由谁飞行每半秒抽一次签，而不是每步一次；卡住的飞行会被截断；每个小批量的一半是示范。

# %%
TOTAL = DEMOS + ROUNDS * PER_ROUND
TRAINING = 2 * STEPS + (ROUNDS - 1) * BETWEEN
dagger = quietly(
    aerial_il.train, "demos", policy=POLICY, run="dagger", evaluate_episodes=1,
    algorithm={"name": "dagger", "rounds": ROUNDS, "episodes": PER_ROUND, "between_steps": BETWEEN, "evaluate_every": 0, "training": {"steps": STEPS}},
)  # fmt: skip
rounds = analysis.metrics("dagger")
rounds[["step", "beta", "flights", "flights_solved", "flight_steps", "expert_steps", "queries", "total/labelled_steps"]].round(2)

# %% [markdown]
# `flight_steps` 中有 `expert_steps` 步由专家飞行；`queries` 是有标注的步数（专家的标签有歧义的状态不标注）。
#
# **对照。** DAgger 比克隆策略多了 30 次飞行，训练也更多。把它与 20 次示范的克隆相比，只会发现数据多有好处，而这一点没有人怀疑。所以：让专家改为再飞 30 次示范，克隆全部 50 次，训练步数与 DAgger 各轮之和相同。

# %%
quietly(aerial_il.collect, ROBOT, TASK, episodes=TOTAL, seed=0, out="more", progress=False)
control = quietly(aerial_il.train, "more", policy=POLICY, algorithm={"steps": TRAINING}, run="control")
NAMES = {"clone": f"clone of {DEMOS}", "dagger": f"DAgger, {DEMOS} + {ROUNDS * PER_ROUND}", "control": f"clone of {TOTAL}"}
flown["dagger"], flown["control"] = fly(dagger, asked=expert), fly(control, asked=expert)
for name in ("expert", *NAMES):
    print(told(name))
for name in ("clone", "control"):
    mine, other = flown["dagger"]["won"], flown[name]["won"]
    alone = int((mine & ~other).sum()), int((other & ~mine).sum())
    print(f"solved by DAgger alone {alone[0]}, by {NAMES[name]} alone {alone[1]}: McNemar's p = {statistics.mcnemar(*alone):.2g}")

# %%
figure, axes = plt.subplots(1, 3, figsize=(13, 3.3), layout="constrained")
colours = {"clone": "C1", "dagger": "C2", "control": "C3"}
for name, colour in colours.items():
    band(axes[0], away(flown[name]), NAMES[name], colour, every=5)
    band(axes[1], flown[name]["apart_cm"], NAMES[name], colour)
band(axes[0], away(flown["expert"]), "expert", "C0", every=5)
axes[0].set(xlabel="time (s)", ylabel="deviations per element", title=f"distance to the first {DEMOS} demonstrations", xlim=(0, 8), yscale="log")
axes[1].set(xlabel="time (s)", ylabel="cm", title="command less expert's, on own states", xlim=(0, 8))
axes[0].legend()
for row, (name, label) in enumerate({"expert": "expert", **NAMES}.items()):
    won = int(flown[name]["won"].sum())
    low, high = (100 * end for end in statistics.wilson(won, FLIGHTS))
    axes[2].errorbar(100 * won / FLIGHTS, row, xerr=[[100 * won / FLIGHTS - low], [high - 100 * won / FLIGHTS]], fmt="o", capsize=4, color=colours.get(name, "C0"))
axes[2].set_yticks(range(4), ["expert", *NAMES.values()])
axes[2].set(xlim=(0, 102), ylim=(3.5, -0.5), xlabel="success within 10 s (%), 95 % Wilson", title="one training each, 60 flights")
plt.show()

# %% [markdown]
# 在这次运行中，DAgger 的学习者解决了 60 个起始状态中的 56 个，它的起点克隆策略解决了 25 个：无论看距离还是看在自己状态上的误差，偏移都消失了。但 50 次示范的克隆策略也是如此，它从未提过任何问题，没有见过任何学习者的状态，却解决了全部 60 个。（它比 DAgger 多解决四个，这个差别 60 次飞行还不足以与偶然区分开。）
#
# 20 次示范的克隆策略与 DAgger 的学习者从同一个起始状态出发，左边是克隆策略。最后它的销钉躺在桌上：

# %%
differ = np.flatnonzero(flown["dagger"]["won"] & ~flown["clone"]["won"])
if can_render() and len(differ):
    world = int(differ[0])
    height, width, every, longest = 190, 250, 15, 330
    with SceneRenderer(env.model_xml) as scene:
        paths = [flown[name]["states"][:, world][:longest] for name in ("clone", "dagger")]
        view = scene.frame([state for path in paths for state in path[::40]], width / height)
        lengths = [min(len(path), int(flown[name]["flying"][:longest, world].sum())) for name, path in zip(("clone", "dagger"), paths, strict=True)]
        beside = [
            np.concatenate([scene.draw(path[min(k, last - 1)], view, height, width) for path, last in zip(paths, lengths, strict=True)], axis=1)
            for k in range(0, max(lengths), every)
        ]
    kept, small = io.BytesIO(), [Image.fromarray(picture).quantize(40) for picture in beside]
    small[0].save(kept, "GIF", save_all=True, append_images=small[1:], duration=20 * every, loop=0)
    print("seed", SEEDS[world])
    display(Film(data=kept.getvalue(), format="gif"))  # noqa: F821  (the notebook's own)
env.close()

# %% [markdown]
# ## 6.4 它值多少
#
# 以上数字是在一批示范上各**训练一次**得到的，网络小，训练少。研究 [experiments/dagger](../../experiments/dagger/README.md) 用默认设置在三批示范上各训练一次，每个策略在 100 个未见过的种子上飞行，直到任务自己的时限。成功率以 % 计，括号中是 95 % 区间：对飞行（Wilson，300 次）；对训练（Student t，3 次）：
#
# | | `insert_peg` | `pick_place` |
# |---|---|---|
# | 克隆 20 次示范 | 43.7（38–49；36–51） | 59.7（54–65；27–92） |
# | DAgger，20 次示范加 50 次有标注的飞行 | 97.0（94–98；93–100） | 94.7（92–97；89–100） |
# | 克隆 70 次示范，训练步数相同 | 99.7（98–100；98–100） | 97.7（95–99；90–100） |
# | DAgger 减去该克隆策略，百分点 | −2.7（−6.5 至 +1.1） | −3.0（−15.4 至 +9.4） |
#
# DAgger 修好了克隆策略，而**让专家再飞同样多次也同样能修好**：在这套任务上，看不出 DAgger 有优势。（不加本项目的改动、完全按论文来做时，它在那里达到 35 % 和 87 %。）这与 6.1 矛盾吗？不矛盾：
#
# - 那些界针对最坏情形，并且假设在相应状态上的误差是*固定*的。多五十次示范会使专家状态上的误差本身变小。
# - 这些示范是有意带着噪声飞的（第 4 篇），因此其中有纠正动作，从一开始就消除了一部分偏移。
# - 这里的专家是脚本，想飞多少次就飞多少次。如果示范昂贵而标注便宜，或者由人在出问题时才接管（`hg_dagger`），账就要另算。
#
# 所以要计算你的专家付出了多少，并且总是把交互式方法与同样多的普通示范相比较。
#
# **出处。** Ross 与 Bagnell，"Efficient reductions for imitation learning"，*AISTATS* 2010，定理 2.1。Ross、Gordon 与 Bagnell，"A reduction of imitation learning and structured prediction to no-regret online learning"，*AISTATS* 2011，定理 2.2、3.1、3.2 与算法 3.1。Laskey 等，"DART"，*CoRL* 2017。Kelly 等，"HG-DAgger"，*ICRA* 2019。本项目的设置：[DAgger 及其同类](../../docs/dagger.md)。
