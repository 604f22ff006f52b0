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
# # 8. 从先验出发的强化学习
#
# 从少数几次示范克隆出来的策略，偶尔能完成任务。没有人再做示范了，但可以看出一次飞行是否成功。只凭每次飞行的这一个比特，克隆策略能靠练习变好吗？这样的克隆策略称为*先验*。没有先验，练习就无从开始：如果成功足够罕见，随机飞行永远碰不到它。有了先验，就有东西可失去：学得太快的学习者会忘掉原来会的。
#
# 所以这里的每条曲线都配有两个数：最终达到多少，以及途中**低于先验的最大跌幅**。本篇先在一个小例子上看这两个数，每种设置训练几次；再看机器人上的专家迭代，训练一次。不运行代码也能读完全篇。

# %%
import contextlib
import io
import json
import os
import tempfile
from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from IPython.display import Image as Film
from PIL import Image

import aerial_il
from aerial_il.presentation import analysis
from aerial_il.collection.collect import collect
from aerial_il.core.rendering import can_render
from aerial_il.evaluation import statistics
from aerial_il.presentation.films.scene_renderer import SceneRenderer

analysis.use_style()
torch.set_num_threads(1)
os.chdir(tempfile.mkdtemp())  # the notebook leaves nothing behind


def quietly(function, *args, **keys):
    with contextlib.redirect_stdout(io.StringIO()):
        return function(*args, **keys)


# %% [markdown]
# ## 8.1 墙上的缺口
#
# 正方形中的一个点，命令是速度，与第 7 篇一样。一堵墙横在中间，某处有一个 20 cm 宽的缺口；碰到墙就出局，穿过缺口就成功，这是唯一的奖励。四次示范只见过四个缺口。

# %%
HALF_GAP, STEP_M, TIME = 0.1, 0.1, 40


class Gap(gymnasium.Env):
    """Place (2,) and the gap's place along the wall (1,); reward 1 for getting through, which ends the flight."""

    observation_space = gymnasium.spaces.Box(-1.2, 1.2, (3,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = np.array([-0.9, self.np_random.uniform(-0.8, 0.8)])
        self.gap = self.np_random.uniform(-0.8, 0.8)
        return self._seen(), {}

    def step(self, action):
        old, self.place = self.place, np.clip(self.place + STEP_M * np.clip(action, -1, 1), -1.2, 1.2)
        crossed = old[0] < 0 <= self.place[0]
        share = -old[0] / (self.place[0] - old[0]) if crossed else 0.0
        through = crossed and abs(old[1] + share * (self.place[1] - old[1]) - self.gap) < HALF_GAP
        return self._seen(), float(through), bool(crossed), False, {}

    def _seen(self):
        return np.array([*self.place, self.gap], np.float32)


gymnasium.register("Gap-v0", entry_point=Gap, max_episode_steps=TIME)
env = aerial_il.load_gymnasium("Gap-v0", num_envs=32, success="return:0.5")
[SEEN] = (field.name for field in env.spec.observation.fields)


class Guide:
    """Fly to a point before the gap, then through."""

    def reset(self, mask=None):
        pass

    def act(self, obs):
        x, y, gap = obs[SEEN].T
        way = np.stack([np.where(np.abs(y - gap) < 0.05, 0.1, np.minimum(-0.25 - x, 0.1)), gap - y], axis=1)
        return way / np.maximum(STEP_M, np.linalg.norm(way, axis=1, keepdims=True))


collect(env, Guide(), range(4), "gaps", progress=False)
few = aerial_il.open_dataset("gaps")
CLONE = {"steps": 600, "validation": 0.0}
prior = quietly(aerial_il.train, "gaps", policy={"name": "mlp", "chunk": 4, "hidden": [64, 64]}, algorithm=CLONE, run="prior")


def through(policy, flights=400, show=None):
    """Success of a policy over unseen starts (n,), and its paths where `show` is a plot."""
    worlds = aerial_il.load_gymnasium("Gap-v0", num_envs=flights, success="return:0.5")
    obs, flying, won, places = worlds.reset(np.arange(10_000, 10_000 + flights)), np.ones(flights, bool), np.zeros(flights, bool), []
    policy.reset()
    while flying.any():
        places.append(np.where(flying[:, None], obs[SEEN], np.nan))
        result = worlds.step(policy.act(obs), flying)
        obs, won = result.obs, won | (flying & result.info["success"])
        flying = flying & ~(result.info["success"] | result.terminated | result.truncated)
    worlds.close()
    if show is not None:
        places = np.array(places)[:, :60]
        for k in range(places.shape[1]):
            show.plot(places[:, k, 0], places[:, k, 1] - places[0, k, 2], lw=0.6, color="C2" if won[k] else "C1")
        show.plot([0, 0, np.nan, 0, 0], [-1.2, -HALF_GAP, np.nan, HALF_GAP, 1.2], color="0.2", lw=3)
    return won


def percent(won):
    low, high = statistics.wilson(int(won.sum()), len(won))
    return f"{100 * won.mean():5.1f} % (Wilson {100 * low:.0f} to {100 * high:.0f}, {len(won)} flights)"


figure, axes = plt.subplots(1, 2, figsize=(9, 3), sharey=True, layout="constrained")
for episode in few:
    axes[0].plot(episode.obs[SEEN][:, 0], episode.obs[SEEN][:, 1] - episode.obs[SEEN][0, 2], color="C0")
axes[0].plot([0, 0, np.nan, 0, 0], [-1.2, -HALF_GAP, np.nan, HALF_GAP, 1.2], color="0.2", lw=3)
axes[0].set(title="four demonstrations", xlabel="towards the wall", ylabel="along the wall, from the gap")
print("prior:", percent(through(prior, show=axes[1])))
axes[1].set(title="the clone; orange: out", xlabel="towards the wall")
plt.show()

# %% [markdown]
# ## 8.2 从克隆策略继续学
#
# `bc_ppo` 就是 PPO（第 3 篇），但策略的起点是克隆策略。一个动作是网络 $f_\theta$ 给出的整个动作块 $c$ 加上噪声。有四项措施保住克隆策略原来会的东西（[说明](../../docs/from_a_prior.md#from-a-clone-on-policy-chunks-as-actions)）：
#
# 1. **预热**：价值网络起初是随机数，跟着它走的策略飞几批就会遗忘。所以在 `warmup` 步之前由先验飞行，只有价值网络在学习；
# 2. **拉回**克隆策略：在损失中加一项散度（如 Baker 等 2022），它逐渐减弱：
#    $L=L_{\text{PPO}}+\lambda\,\mathbb E\,\mathrm{KL}\big(\pi_\theta\,\|\,\pi_{\text{clone}}\big)$；
# 3. **小步**：一批数据上的更新，在某一遍使策略移动超过 `target_kl` 的 1.5 倍之后就停止；
# 4. **闸门**：如果一批飞行的回报比先验低两个标准误以上，就恢复最近一次合格的权重。
#
# 三种设置，每种三次训练，都从*同一个*克隆策略出发：四项全用；全不用；以及用同样多的步数从零开始的 PPO，这个对照说明先验值多少。

# %%
SEEDS = (0, 1, 2)
PPO = {
    "name": "bc_ppo", "prior": "prior", "steps": 36_000, "rollout": {"steps": 2400, "epochs": 8}, "exploration": {"execute": 4}, "gamma": 0.98,
    "lr": 2e-3, "critic_lr": 3e-3, "patience": 2.0, "critic_hidden": [64, 64], "cadence": {"log_every": 2400},
}  # fmt: skip
SETTINGS = {
    "guarded": {**PPO, "warmup": 4800, "kl": 0.003, "target_kl": 0.05, "gate": 2.0},
    "unguarded": {**PPO, "warmup": 0, "kl": 0.0, "target_kl": 0.0, "gate": 1000.0},
    "scratch": {
        "name": "ppo", "reward": "sparse", "steps": 36_000, "rollout": {"steps": 2400, "epochs": 5, "batch_size": 256}, "gamma": 0.98, "lr": 1e-3,
        "cadence": {"log_every": 2400},
    },  # fmt: skip
}
for name, algorithm in SETTINGS.items():
    for seed in SEEDS:
        begins = {"env": "gymnasium:Gap-v0", "success": "return:0.5"} if name == "scratch" else {"dataset": "gaps", "policy": {"name": "mlp", "chunk": 4, "hidden": [64, 64]}}
        if name == "scratch":
            begins["policy"] = {"name": "squashed_gaussian", "hidden": [64, 64]}
        quietly(
            aerial_il.train, algorithm=algorithm, run=f"{name}/{seed}", seed=seed, num_envs=32, threads=1,
            evaluate_every=2400, evaluate_episodes=200, **begins,
        )  # fmt: skip

# %%
def curve(run):
    """Environment steps and success on the way; that at step 0 is the prior's."""
    found = analysis.metrics(run)[["step", "evaluate/success"]].dropna()
    return found["step"].to_numpy(), 100 * found["evaluate/success"].to_numpy()


figure, axes = plt.subplots(1, 2, figsize=(11, 3.4), layout="constrained", width_ratios=(3, 2))
base = curve("guarded/0")[1][0]
axes[0].axhline(base, color="0.4", ls="--", lw=1)
axes[0].text(100, base + 4, "the prior", color="0.3")
print(f"{'setting':10s} {'seed':>4s}  {'largest dip below the prior':>28s}   judged, 400 unseen starts")
for k, name in enumerate(SETTINGS):
    curves = [curve(f"{name}/{seed}") for seed in SEEDS]
    for seed, (steps, rates) in zip(SEEDS, curves, strict=True):
        axes[0].plot(steps, rates, color=f"C{k}", lw=0.7, alpha=0.6)
        dip = "(no prior)" if name == "scratch" else f"{max(0.0, rates[0] - rates.min()):.1f} points"
        won = through(aerial_il.load_policy(f"{name}/{seed}"))
        print(f"{name:10s} {seed:4d}  {dip:>28s}   {percent(won)}")
        axes[1].plot(100 * won.mean(), k + 0.12 * (seed - 1), "o", color=f"C{k}")
    axes[0].plot(curves[0][0], np.mean([rates for _, rates in curves], axis=0), color=f"C{k}", lw=2, label=name)
won = 100 * through(prior).mean()
axes[1].axvline(won, color="0.4", ls="--", lw=1)
axes[1].set_yticks(range(3), list(SETTINGS))
axes[1].set(xlim=(-2, 102), ylim=(2.5, -0.5), xlabel="success of the finished policy (%)", title="three trainings each")
axes[0].set(xlabel="environment steps", ylabel="success on the way (%)", ylim=(-2, 102), title="thin: each training; thick: mean")
axes[0].legend()
plt.show()

# %% [markdown]
# 怎样解读。曲线上每一点是 200 次飞行，可能有六个百分点的误差；最后一列是在未见过的起始状态上飞行 400 次。
#
# - **有保护**（guarded）：三次训练从未低于先验，最后都高于先验：87、79 和 84 %，而先验为 77 %。
# - **无保护**（unguarded）：下跌都不超过 1.5 个百分点，这只是偶然；最后为 80、83 和 80 %。所以在这样容易的任务上，用这个学习率，三次训练看不出保护措施的用处。在本篇的较早版本中，设置相同，三次都立即下跌了 12 到 36.5 个百分点，然后又爬了上来：学习率是否过高，事后才知道，而在机器人上，这样的下跌意味着坠机。保护措施是为事先不知道合适学习率的人准备的。
# - **从零开始**（scratch）：三次中有一次从未穿过缺口，另外两次用同样多的步数达到 48 % 和 72 %。这个例子容易：随机飞行偶尔会碰上缺口。在下面的机器人上，方块要夹住、提起、移过去再放开，就不能指望这种运气了。
#
# ## 8.3 在机器人上：专家迭代
#
# `pick_place`，机器人 `fa_hexa_arm4`，从十次示范出发。每次飞行一个比特，对其中两百步的每一步几乎说明不了什么。比梯度更简单的想法是：**从许多起始状态飞行，留下成功的，再克隆**。这就是用 0 或 1 的奖励加权的克隆，也是朝更好的策略迈出的一步：记 $\pi_{\text{new}}(a|s)\propto\pi(a|s)\,P(\text{成功}\mid s,a)$，用最大似然把 $\pi_{\text{new}}$ 投影到网络上，*就是*克隆成功的飞行（Dayan 与 Hinton 1997；`algorithm=filtered_bc`）。它的弱点是：如果从某个起始状态出发没有一次飞行成功，就什么也学不到，加噪声的帮助也不大。
#
# 因此 `algorithm=expert_iteration` 对每个起始状态重试几次，并随机*隐藏*观测的一部分：十次示范的克隆策略失败的地方，是它依赖了某种巧合，例如碗总是在右边；隐藏这个输入，它就只好不用它（参照 de Haan 等 2019）。飞这些尝试的是另一个克隆策略，即训练时就随机隐藏输入的探索者。每个起始状态只留下一次成功，因此困难的起始状态与容易的同样重要（Anthony 等 2017：用更好的策略规划，克隆它，重复）。

# %%
ROBOT, TASK, FLIGHTS, LIMIT = "fa_hexa_arm4", "pick_place", 60, 500
POLICY, CLONING = {"name": "mlp", "hidden": [128, 128]}, {"steps": 2500, "validation": 0.0}
demos = quietly(aerial_il.collect, ROBOT, TASK, episodes=10, seed=0, out="demos", progress=False)
plain = quietly(aerial_il.train, "demos", policy=POLICY, algorithm=CLONING, run="alone")
iterated = quietly(
    aerial_il.train, "demos", policy=POLICY, run="practised", num_envs=120, evaluate_episodes=1,
    algorithm={
        "name": "expert_iteration", "rounds": 1, "episodes": 240, "attempts": 6, "evaluate_every": 0,
        "training": CLONING, "between_steps": 2500,
    },
)  # fmt: skip
rounds = analysis.metrics("practised").dropna(subset=["flights"])
rounds[["step", "flights", "flights_solved", "flight_steps", "starts_solved_first", "starts_solved", "total/flight_steps"]].round(2)

# %%
worlds = aerial_il.load_batch(ROBOT, TASK, num_envs=FLIGHTS, num_threads=2)


def judged(policy):
    """Success within LIMIT steps from unseen starts (n,), and the states flown (T, n, S) with who was in the air (T, n)."""
    obs = worlds.reset(np.arange(10_000, 10_000 + FLIGHTS))
    policy.reset()
    flying, won, states, air = np.ones(FLIGHTS, bool), np.zeros(FLIGHTS, bool), [], []
    for _ in range(LIMIT):
        states.append(worlds.get_state())
        air.append(flying)
        result = worlds.step(policy.act(obs), flying)
        obs, won = result.obs, won | (flying & result.info["success"])
        flying = flying & ~(result.info["success"] | result.terminated | result.truncated)
        if not flying.any():
            break
    return won, np.array(states), np.array(air)


results = {"clone of 10": judged(plain), "expert iteration, 1 round": judged(iterated)}
for name, (won, *_) in results.items():
    print(f"{name:28s} {won.sum():2d} of {FLIGHTS} within 10 s: {percent(won)}")
first, second = (won for won, *_ in results.values())
alone = int((second & ~first).sum()), int((first & ~second).sum())
print(f"solved after practice alone {alone[0]}, by the clone alone {alone[1]}: McNemar's p = {statistics.mcnemar(*alone):.2g}")

# %%
figure, axis = plt.subplots(figsize=(7, 1.8), layout="constrained")
for row, (name, (won, *_)) in enumerate(results.items()):
    low, high = (100 * end for end in statistics.wilson(int(won.sum()), FLIGHTS))
    axis.errorbar(100 * won.mean(), row, xerr=[[100 * won.mean() - low], [high - 100 * won.mean()]], fmt="o", capsize=4)
axis.set_yticks(range(2), list(results))
axis.set(xlim=(0, 102), ylim=(1.6, -0.6), xlabel="success within 10 s (%), 95 % Wilson", title="one training each, 60 flights")
plt.show()

# %% [markdown]
# 克隆策略（左）与由它练习而来的策略，从同一个起始状态出发：

# %%
differ = np.flatnonzero(second & ~first)
if can_render() and len(differ):
    world, height, width, every, longest = int(differ[0]), 190, 250, 15, 330
    both = [(states[:longest, world], int(air[:longest, world].sum())) for _, states, air in results.values()]
    with SceneRenderer(worlds.model_xml) as scene:
        view = scene.frame([state for states, _ in both for state in states[::40]], width / height)
        beside = [
            np.concatenate([scene.draw(states[min(k, last - 1)], view, height, width) for states, last in both], axis=1)
            for k in range(0, max(last for _, last in both), every)
        ]
    kept, small = io.BytesIO(), [Image.fromarray(picture).quantize(40) for picture in beside]
    small[0].save(kept, "GIF", save_all=True, append_images=small[1:], duration=20 * every, loop=0)
    print("seed", 10_000 + world)
    display(Film(data=kept.getvalue(), format="gif"))  # noqa: F821  (the notebook's own)
worlds.close()
env.close()

# %% [markdown]
# 怎样解读。在这次运行中，一轮练习使克隆策略解决的起始状态从 60 个中的 13 个增加到 29 个；其中 19 个是练习之后才解决的，3 个是练习之前才能解决的。它用了 1,043 次飞行，即 334,000 步，相当于在仿真中飞 1.9 小时，以及 106 个表示"成功"的比特。在相信它之前要知道两件事：
#
# - 这些成功有一半是克隆策略自己的：它第一次尝试就解决了这一轮 240 个起始状态的 21 %（`starts_solved_first`，时限更紧），探索者在最多五次后续尝试中又解决了 23 %。对学习者来说，新的只有后者。
# - 这是一次训练，而且是第三次尝试；前两次是本篇不会重复的试验。第一次的练习只有一半（两轮，每轮 80 个起始状态，四次尝试，每次训练 1500 步），从 60 个中的 15 个到 18 个（McNemar 的 p = 0.63）：没有效果。第二次用的是算法的较早版本，学习者自己也在隐藏字段的条件下训练，从 13 个到 34 个：飞行次数少时隐藏对学习者也有帮助，多时则[有害](../../docs/reinforcement_trials.md#expert-iteration)。
#
# ## 8.4 研究的结果
#
# [experiments/from_prior](../../experiments/from_prior/README.md) 更充分地研究同一个问题：几种方法，各在若干批十次示范上训练（批数见表），在未见过的种子上飞行，直到任务自己的时限。设置见其 `results.json`，下表也由此读出：学习时飞行的控制步数；成功率（%）及其对飞行、对训练的 95 % 区间；从未在其中练习的阵风中的成功率；以及低于先验的最大跌幅，以百分点计。名称与该页相同：`bc, first demonstrations` 是十次示范的克隆策略，`bc, as practice begins` 是多数方法的起点，`bc, many demonstrations` 是多得多的示范的克隆策略。

# %%
STUDY, BEGUN = "experiments/from_prior/results.json", 10
kept = Path(aerial_il.__file__).parents[1] / STUDY
tables = json.loads(kept.read_text())["tables"] if kept.is_file() else {"Success": [], "Dips": []}
success, dips = ([row for row in tables[name] if (row["task"], row["demos"]) == (TASK, BEGUN)] for name in ("Success", "Dips"))
calm, gusts = ({row["arm"]: row for row in success if row["tier"] == tier} for tier in ("calm", "gusts"))
if not calm:
    print(f"The study is left out: there is no {STUDY}, which a checkout of the repository has, or it has no {TASK} from {BEGUN} demonstrations.")


def interval(row, unit):
    """One of a row's 95 % intervals; a single training has none over trainings."""
    return "" if row[f"{unit}_low"] is None else f"{row[f'{unit}_low']:.0f} to {row[f'{unit}_high']:.0f}"


largest_dips = {row["arm"]: row["dip"] for row in dips}
pd.DataFrame(
    {
        "arm": name, "trainings": row["trainings"], "flown (millions)": round(row["flown"] / 1e6, 1), "calm": row["percent"], "over flights": interval(row, "flights"),
        "over trainings": interval(row, "trainings"), "gusts": gusts[name]["percent"], "largest dip": largest_dips.get(name),
    }
    for name, row in calm.items()
)  # fmt: skip

# %%
if calm:
    figure, axis = plt.subplots(figsize=(7, 1 + 0.35 * len(calm)), layout="constrained")
    for k, row in enumerate(calm.values()):
        axis.errorbar(
            row["percent"], k, xerr=[[row["percent"] - row["flights_low"]], [row["flights_high"] - row["percent"]]], fmt="s", capsize=4, color=f"C{k}"
        )  # fmt: skip
    axis.set_yticks(range(len(calm)), [f"{name} ({row['trainings']})" for name, row in calm.items()])
    axis.set(xlim=(0, 102), ylim=(len(calm) - 0.4, -0.6), xlabel="success (%), 95 % Wilson", title="the study, in calm (number of trainings)")
    plt.show()

# %% [markdown]
# 怎样解读。练习值多少，要看一种方法比同样十次示范的克隆策略高多少，也要看它比过滤克隆高多少，后者同样只需要 0 或 1 的奖励；如果对训练的区间向下伸到它们那里，换一批示范就可能什么也看不出来；只有一次训练则没有这个区间。再与 `bc, many demonstrations` 比较：**谁的专家能飞那么多次，就应当让它飞。** 练习是为那些有十次示范而不会再有的人准备的。
#
# **出处。** Schulman 等，"Proximal policy optimization algorithms"，2017。Baker 等，"Video pretraining (VPT)"，*NeurIPS* 2022（拉回）。Ren 等，"Diffusion policy policy optimization"，2024（以动作块为动作）。Dayan 与 Hinton，"Using expectation-maximization for reinforcement learning"，*Neural Computation* 1997。Anthony、Tian 与 Barber，"Thinking fast and slow with deep learning and tree search"，*NeurIPS* 2017。de Haan、Jayaraman 与 Levine，"Causal confusion in imitation learning"，*NeurIPS* 2019。全部方法：[强化学习](../../docs/from_a_prior.md)。
