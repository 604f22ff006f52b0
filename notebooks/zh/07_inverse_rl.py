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
# # 7. 逆强化学习与 GAIL：画出学到的奖励
#
# 克隆抄的是*做了什么*。逆强化学习问的是*为了什么而做*：什么样的奖励会使示范成为最好的做法？这个问题没有唯一的答案，本篇先在一张 54 格的地图上精确地说明这一点；然后在那里从示范中求出一个奖励（最大熵），再转到让奖励与策略互相对抗着学习的 GAIL，画出 GAIL 学到的奖励，最后在没有示范的条件下把这一切再做一遍，作为这类结果所必需的对照。不运行代码也能读完全篇。

# %%
import contextlib
import io
import os
import tempfile
from dataclasses import replace

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch
from IPython.display import Image as Film
from PIL import Image
from scipy.special import logsumexp

import aerial_il
from aerial_il.presentation import analysis
from aerial_il.algorithms.adversarial.reward_net import load_reward
from aerial_il.algorithms.gail import GAIL
from aerial_il.algorithms.online.interface import encode, encode_actions
from aerial_il.collection.collect import collect
from aerial_il.core.rendering import can_render
from aerial_il.evaluation import statistics
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.policies.squashed_gaussian import SquashedGaussian

analysis.use_style()
torch.set_num_threads(1)
os.chdir(tempfile.mkdtemp())  # the notebook leaves nothing behind

# %% [markdown]
# ## 7.1 许多奖励，一种行为
#
# 第 3 篇的走廊：6 行 9 列，四个方向加*停留*；有 0.2 的概率，风会把飞行器改为向下吹一格。在停机坪（右侧）上每一步得 1，在树篱（最下面一行）里每一步扣 1。示范者很少是完美的，所以让它是*软*的：它以概率 $\pi(a|s)=e^{(Q(s,a)-V(s))/\tau}$ 选择动作，其中
#
# $$ Q(s,a)=r(s,a)+\gamma\,\mathbb E[V(s')],\qquad V(s)=\tau\log\sum_a e^{Q(s,a)/\tau}. $$
#
# 这是对"奖励加 $\tau$ 倍熵"最优的策略（Ziebart 2010）。现在取*任意*一个状态函数 $\Phi$，改为支付 $r'=r+\gamma\,\mathbb E\,\Phi(s')-\Phi(s)$。把 $Q'=Q-\Phi(s)$ 与 $V'=V-\Phi(s)$ 代入上面两个方程：等式成立。所以 $Q'-V'=Q-V$，**策略直到最后一位都相同**（Ng、Harada 与 Russell 1999：奖励塑形）。取 $\Phi=V$ 就得到 $r'=Q-V=\tau\log\pi$：策略自身的对数就是一个能完美解释它的奖励，而它包含的信息并不比一个克隆策略多。

# %%
ROWS, COLUMNS, GAMMA, TAU = 6, 9, 0.95, 0.2
PAD = 2 * COLUMNS + COLUMNS - 1  # number of that field
MOVES = np.array([[-1, 0], [0, 1], [1, 0], [0, -1], [0, 0]])  # up, right, down, left, stay
PLACES = np.array([(r, c) for r in range(ROWS) for c in range(COLUMNS)])


def dynamics(wind):
    """(actions, states, states) probabilities; the wind carries by `wind` with probability 0.2."""
    found = np.zeros((len(MOVES), len(PLACES), len(PLACES)))
    for action, move in enumerate(MOVES):
        for share, way in ((0.8, move), (0.2, np.array(wind))):
            to = np.clip(PLACES + way, 0, [ROWS - 1, COLUMNS - 1])
            found[action, np.arange(len(PLACES)), to[:, 0] * COLUMNS + to[:, 1]] += share
    return found


def soft(reward, P, V=None, sweeps=400):
    """Soft-optimal policy (S, A) for a reward (S, A), and its V."""
    V = np.zeros(len(PLACES)) if V is None else V
    for _ in range(sweeps):
        Q = reward + GAMMA * (P @ V).T
        V = TAU * logsumexp(Q / TAU, axis=1)
    return np.exp((Q - V[:, None]) / TAU), V


def visits(policy, P):
    """Discounted share of time in each state, from anywhere."""
    moved = np.einsum("sa,ast->st", policy, P)
    return (1 - GAMMA) * np.linalg.solve(np.eye(len(PLACES)) - GAMMA * moved.T, np.full(len(PLACES), 1 / len(PLACES)))


def on_states(values):
    return np.repeat(np.asarray(values)[:, None], len(MOVES), axis=1)


P = dynamics(wind=(1, 0))
true = on_states(1.0 * (np.arange(len(PLACES)) == PAD) - 1.0 * (PLACES[:, 0] == ROWS - 1))
demonstrator, V = soft(true, P)
rng = np.random.default_rng(7)
shape = rng.normal(0, 3, len(PLACES))
REWARDS = {
    "true": true,
    "shaped by random numbers": true + GAMMA * (P @ shape).T - shape[:, None],
    "log of the policy": TAU * np.log(demonstrator),
}


def map_of(axis, values, policy, title, **keys):
    axis.imshow(values.reshape(ROWS, COLUMNS), cmap="RdYlGn", **keys)
    for (row, column), action in zip(PLACES, policy.argmax(axis=1), strict=True):
        up, across = 0.35 * MOVES[action]
        if up or across:
            axis.annotate("", xy=(column + across, row + up), xytext=(column - across, row - up), arrowprops={"arrowstyle": "->", "lw": 0.8})
        else:
            axis.plot(column, row, "k.", ms=3)
    axis.set(title=title, xticks=[], yticks=[])
    axis.grid(False)


figure, axes = plt.subplots(1, 3, figsize=(13, 3), layout="constrained")
for axis, (name, reward) in zip(axes, REWARDS.items(), strict=True):
    policy, _ = soft(reward, P)
    map_of(axis, reward.max(axis=1), policy, name)
    print(f"{name:26s} largest difference of the policy: {np.abs(policy - demonstrator).max():.1e}")
figure.suptitle("reward of each field (of its best action), and the policy that follows from it")
plt.show()

# %% [markdown]
# 三张图看起来像三个任务，行为却只有一种。所以示范*再多*也无法区分它们；学到的奖励只确定到相差一个塑形项为止。这要紧吗？如果只想重现这种行为，不要紧。但如果要把奖励用到**别处**，就要紧了：让风改为向左吹，再用每一个奖励重新规划。

# %%
other = dynamics(wind=(0, -1))
best = visits(soft(true, other)[0], other) @ true[:, 0]
print(f"in the other wind, mean true reward of a step: best {best:.3f}; the old policy {visits(demonstrator, other) @ true[:, 0]:.3f}; planned anew with")
for name, reward in REWARDS.items():
    policy, _ = soft(reward, other)
    print(f"    {name:26s} {visits(policy, other) @ true[:, 0]:7.3f}")

# %% [markdown]
# 策略的对数要求的是旧的行为，不管现在的风怎样。塑形后的奖励在这里失败，是因为塑形项是按*旧的*风折算进 $r(s,a)$ 的；如果按实际发生的转移支付 $\gamma\Phi(s')-\Phi(s)$，它在任何地方都无害。Fu、Luo 与 Levine（2018，第 5 节）由此得出结论：让奖励只依赖于**状态**，并给塑形项一个单独的网络，学完就丢掉。这就是 AIRL（`algorithm=airl`，`reward_on=state`）。
#
# ## 7.2 最大熵：求出一个
#
# 寻找使示范的似然最大的奖励 $r(s)$。对数似然的梯度是访问频率之差（Ziebart 等 2008）：示范者比当前奖励的策略更常到的地方，提高奖励；更少到的地方，降低奖励，
#
# $$ \frac{\partial\mathcal L}{\partial r(s)}\;\propto\;\mu_{E}(s)-\mu_{\pi_r}(s) . $$

# %%
wanted, learned, V, gaps = visits(demonstrator, P), np.zeros(len(PLACES)), None, []
for turn in range(600):
    policy, V = soft(on_states(learned), P, V, sweeps=15)
    gap = wanted - visits(policy, P)
    learned += 5.0 * gap
    gaps.append(np.abs(gap).sum())
policy, _ = soft(on_states(learned), P)
elsewhere, _ = soft(on_states(learned), other)
figure, axes = plt.subplots(1, 3, figsize=(13, 3), layout="constrained")
map_of(axes[0], true[:, 0], demonstrator, "true reward")
map_of(axes[1], learned, policy, "learned from visits")
axes[2].semilogy(gaps)
axes[2].set(xlabel="turn", ylabel="sum of differences of visits", title="it converges")
plt.show()
print(f"largest difference of the policy {np.abs(policy - demonstrator).max():.3f}; correlation with the true reward {np.corrcoef(learned, true[:, 0])[0, 1]:.2f}")
print(f"planned anew in the other wind: {visits(elsewhere, other) @ true[:, 0]:.3f} (best {best:.3f})")

# %% [markdown]
# 它需要动力学模型、状态表，而且梯度的每一步都要做一次完整的规划。机器人一样都没有。
#
# ## 7.3 GAIL：判别器就是奖励
#
# 生成对抗模仿学习（Ho 与 Ermon 2016）保留了"*到示范者所在的地方去*"这个想法，去掉了规划。判别器 $D(s,a)$ 学习把示范的状态—动作对与飞行得到的区分开，策略则因被当作示范者而得到奖励：
#
# $$ \min_\pi\max_D\;\mathbb E_{E}[\log D(s,a)]+\mathbb E_{\pi}[\log(1-D(s,a))]-\lambda H(\pi),\qquad r(s,a)=-\log(1-D(s,a)) . $$
#
# （论文中 $D$ 与 $1-D$ 的角色互换。）对固定的策略，用访问频率 $\rho_E,\rho_\pi$ 把两个期望写成对状态—动作对的一个求和，令导数 $\rho_E/D-\rho_\pi/(1-D)$ 为零，得到最优判别器
#
# $$ D^*(s,a)=\frac{\rho_E(s,a)}{\rho_E(s,a)+\rho_\pi(s,a)},\qquad \log\frac{D^*}{1-D^*}=\log\frac{\rho_E(s,a)}{\rho_\pi(s,a)} . $$
#
# 代入之后，这个博弈最小化的是访问频率之间的 Jensen–Shannon 散度。而在终点 $\rho_\pi=\rho_E$ 处，最优判别器**处处**为 $\tfrac12$：完全成功的 GAIL，其奖励是一个常数。它是某个学习者在某一时刻的路标，而不是示范者的目的。
#
# 一个可以画出来的例子：从上方看的飞行器，命令是速度。示范者从左下方飞到右上方的停机坪，从左边绕过一块田（灰色），虽然并没有什么阻止它们从上面穿过。没有人把停机坪或田告诉学习者；它得到的只是十次飞行。

# %%
PAD_AT, TURN_AT, FIELD_M, STEP_M, TIME = np.array([0.7, 0.7]), np.array([-0.6, 0.5]), 0.35, 0.1, 40


class Around(gymnasium.Env):
    """A point in a square, told its velocity. Its reward is for judging alone; no algorithm here sees it."""

    observation_space = gymnasium.spaces.Box(-1.2, 1.2, (2,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = self.np_random.uniform([-0.95, -0.95], [-0.4, -0.4])
        return self.place.astype(np.float32), {}

    def step(self, action):
        self.place = np.clip(self.place + STEP_M * np.clip(action, -1, 1), -1.2, 1.2)
        return self.place.astype(np.float32), float(np.hypot(*(self.place - PAD_AT)) < 0.15), False, False, {}


gymnasium.register("Around-v0", entry_point=Around, max_episode_steps=TIME)
env = aerial_il.load_gymnasium("Around-v0", num_envs=8)
[SEEN] = (field.name for field in env.spec.observation.fields)


class Guide:
    """Fly to the turning point while below it, then to the pad."""

    def reset(self, mask=None):
        pass

    def act(self, obs):
        place = obs[SEEN]
        below = (place[:, 0] < 0.0) & (place[:, 1] < TURN_AT[1] - 0.05)
        way = np.where(below[:, None], TURN_AT, PAD_AT) - place
        return way / np.maximum(STEP_M, np.linalg.norm(way, axis=1, keepdims=True))


collect(env, Guide(), range(10), "around", progress=False)
guided = aerial_il.open_dataset("around")
print(len(guided), "demonstrations of", len(guided[0]), "steps")

# %%
PPO = {"steps": 40_960, "rollout": replace(GAIL.rollout, steps=512), "gamma": 0.95, "lr": 1e-3, "cadence": replace(GAIL.cadence, log_every=2048)}
DISCRIMINATOR = {"reward": replace(GAIL.reward, updates=32, lr=3e-3), "reward_batch": 256}
ACTOR = SquashedGaussian(hidden=(64, 64), activation="tanh", spread="free")
settings = GAIL(**PPO, **DISCRIMINATOR)
imitator = settings.train(list(guided), ACTOR, env=env, run="gail")
control = replace(settings, demonstrations=replace(settings.demonstrations, control="random_actions"))
control = control.train(list(guided), ACTOR, env=env, run="control")


def paths_of(policy, flights=40):
    """(T + 1, n, 2) places on unseen starts."""
    worlds = aerial_il.load_gymnasium("Around-v0", num_envs=flights)
    obs = worlds.reset(np.arange(10_000, 10_000 + flights))
    policy.reset()
    places = [obs[SEEN].copy()]
    for _ in range(TIME - 1):
        obs = worlds.step(policy.act(obs)).obs
        places.append(obs[SEEN].copy())
    worlds.close()
    return np.array(places)


flown = {"the guide": paths_of(Guide()), "GAIL": paths_of(imitator), "control: random demonstrations": paths_of(control)}
for name, places in flown.items():
    there = np.hypot(*(places[-1] - PAD_AT).T) < 0.15
    crossed = (np.hypot(places[..., 0], places[..., 1]) < FIELD_M).any(axis=0)
    texts = []
    for found in (there, crossed):
        low, high = statistics.wilson(int(found.sum()), len(found))
        texts.append(f"{found.sum():2d} of {len(found)} ({100 * low:.0f}-{100 * high:.0f} %)")
    print(f"{name:32s} at the pad in the end {texts[0]:22s} over the field {texts[1]}")

# %% [markdown]
# ### 地图上学到的奖励
#
# 判别器在每个位置给多少奖励？它也评判动作，所以颜色表示 16 个方向与*停留*之中最好的一个所得的奖励，箭头就是那个方向。

# %%
side = np.linspace(-1.15, 1.15, 24)
grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
WAYS = np.concatenate([np.stack([np.cos(turns), np.sin(turns)], axis=1), np.zeros((1, 2))])


def paid_at(run):
    """(places, ways) what the reward learned by a run pays."""
    reward, interface = load_reward(run)
    paid = []
    for way in WAYS:
        obs = np.pad(encode(interface, grid.astype(np.float32)), ((0, 0), (0, 1)))  # the last element marks an end
        actions = encode_actions(interface, np.tile(way, (len(grid), 1)), grid)
        paid.append(reward.reward(torch.tensor(obs), torch.tensor(actions)).numpy())
    return np.stack(paid, axis=1)


figure, axes = plt.subplots(1, 4, figsize=(14.5, 3.7), layout="constrained")
for axis, (name, places) in zip(axes[:2], list(flown.items())[:2], strict=True):
    axis.plot(places[..., 0], places[..., 1], lw=0.7, color="C0")
    axis.set_title(f"40 flights of {name}")
for axis, (run, name) in zip(axes[2:], {"gail": "reward learned by GAIL", "control": "by the control"}.items(), strict=True):
    paid = paid_at(run)
    picture = axis.pcolormesh(side, side, paid.max(axis=1).reshape(24, 24), cmap="viridis")
    figure.colorbar(picture, ax=axis, shrink=0.8)
    across, up = WAYS[paid.argmax(axis=1)].T
    axis.quiver(grid[::2, 0], grid[::2, 1], across[::2], up[::2], color="w", scale=28, width=0.004)
    axis.plot(flown["GAIL" if run == "gail" else "control: random demonstrations"][:, :10, 0], flown["GAIL" if run == "gail" else "control: random demonstrations"][:, :10, 1], color="C1", lw=0.7)
    axis.set_title(name)
for axis in axes:
    axis.add_patch(plt.Circle((0, 0), FIELD_M, facecolor="0.5", alpha=0.5))
    axis.plot(*PAD_AT, "*", ms=10, color="C3")
    axis.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal")
plt.show()
figure, axes = plt.subplots(figsize=(6.4, 2.6), layout="constrained")
for name in ("gail", "control"):
    logged = analysis.metrics(name)
    for column, line in {"reward/acc_expert": "-", "reward/acc_agent": ":"}.items():
        part = logged.dropna(subset=[column])
        axes.plot(part["step"], part[column], line, color="C0" if name == "gail" else "C1", label=f"{name}: {column[11:]}")
axes.set(xlabel="environment steps", ylabel="accuracy", ylim=(0, 1.02), title="does the discriminator tell them apart?")
axes.legend(ncol=2)
plt.show()

# %% [markdown]
# 怎样解读。在这次运行中，模仿者从 40 个未见过的起始状态中的 40 个都飞到了停机坪，并且绕开了那块田，尽管从来没有人把二者告诉它，环境的奖励也从未传给它；向导急转弯的地方，它绕得更圆。它学到的奖励是沿着示范路线的一道山脊，在转折点和停机坪处最高，在没有示范者到过的田上方较低。箭头在转折点以下是*向上*，过了转折点是*向右*，在停机坪处是*停留*（圆点）。但它并不是示范者的目的"到停机坪去"：在山脊上，继续飞所得的奖励几乎与到达一样多；而在远离路线的右下方，示范者和学习者都没有到过，那里的颜色只是网络的猜测。
#
# 最后一幅图是博弈的状态：到最后，判别器仍能认出十分之九的示范状态—动作对和四分之三的飞行状态—动作对。如果二者没有区别，两者都应是一半，而按照 7.3，奖励图就只有一种颜色。
#
# 对照用同样的程序、同样的网络、同样的步数，但用随机飞行代替示范。它也学到一个策略和一个奖励，也有山丘和箭头，却没有任何意义。这样的对照所达到的任何东西都不是模仿：因保持直立而得到奖励的学习者，就会保持直立。读每一篇无奖励模仿的论文时，都要找找有没有这个对照。
#
# ## 7.4 在机器人上
#
# `reach`，机器人 `fa_hexa_arm4`：把工具移到标出的位姿。专家以固定长度（5 s）飞行二十次（在这次运行中，最后在目标处的有 18 次，算作示范），因此其中包含在目标处的悬停：否则就只有学习者会在目标处悬停，判别器学到的就会是这一点。这里 GAIL 从克隆策略开始，给判别器看的示范动作加上学习者自己的探索噪声，并且不让任何一方看到机器人在世界中的位置。每一项设置都堵住一条线索，否则判别器不看任务就能据此区分二者（[原因](../../docs/adversarial.md#spurious-cues-for-the-discriminator)）。研究中的飞行步数是这里的十六倍。

# %%
ROBOT, FLIGHTS = "fa_hexa_arm4", 60
SEES = {"name": "squashed_gaussian", "hidden": [128, 128], "relative": True, "anchor": "ee_pos", "masked_fields": ["base_*", "joint_*", "ee_*"], "spread": "free", "log_std": -3.0}
GAIL = {
    "name": "gail", "steps": 32_000, "demonstrations": {"bounds": "demonstrations", "labels": "expert"}, "bc_pretrain_steps": 1000, "warmup": 6400,
    "rollout": {"steps": 6400, "epochs": 5, "batch_size": 512}, "lr": 1e-4, "gamma": 0.97, "target_kl": 0.01, "critic_hidden": [128, 128],
    "reward": {"updates": 32, "action_noise": True}, "cadence": {"log_every": 6400},
}  # fmt: skip


def quietly(function, *args, **keys):
    with contextlib.redirect_stdout(io.StringIO()):
        return function(*args, **keys)


demos = quietly(aerial_il.collect, ROBOT, "reach", episodes=20, horizon=250, expert={"noise": 0.1}, out="reach", progress=False)
random = {"demonstrations": {**GAIL["demonstrations"], "control": "random_actions"}, "warmup": 0}
kinds = {"clone alone": {"steps": 6400, "warmup": 6400}, "GAIL": {}, "control: random actions": random}
policies = {
    name: quietly(aerial_il.train, "reach", policy=SEES, algorithm={**GAIL, **change}, num_envs=32, run=f"reach_{k}")
    for k, (name, change) in enumerate(kinds.items())
}

# %%
worlds = aerial_il.load_batch(ROBOT, "reach", num_envs=FLIGHTS, num_threads=2, horizon=250)


def hover(policy):
    """(T, n) distance of the tool to the target, m; (T, n) success; and the states of world 0."""
    obs, apart, won, states = worlds.reset(np.arange(10_000, 10_000 + FLIGHTS)), [], [], []
    if hasattr(policy, "attach"):
        policy.attach(worlds)
    policy.reset()
    for _ in range(250):
        states.append(worlds.get_state()[0])
        result = worlds.step(policy.act(obs))
        obs = result.obs
        apart.append(np.linalg.norm(obs["tool_to_target"], axis=1))
        won.append(result.info["success"])
    return np.array(apart), np.array(won), np.array(states)


hovers = {"expert": hover(aerial_il.expert(ROBOT, "reach"))} | {name: hover(policy) for name, policy in policies.items()}
figure, axes = plt.subplots(figsize=(6.4, 3), layout="constrained")
for name, (apart, won, _) in hovers.items():
    low, high = statistics.wilson(int(won.any(axis=0).sum()), FLIGHTS)
    print(f"{name:24s} {won.any(axis=0).sum():3d} of {FLIGHTS} within 5 s ({100 * low:.0f}-{100 * high:.0f} %, Wilson); median distance in the end {100 * np.median(apart[-1]):5.1f} cm")
    axes.plot(0.02 * np.arange(250), 100 * np.median(apart, axis=1), label=name)
axes.axhline(2, color="0.5", lw=0.8)
axes.set(xlabel="time (s)", ylabel="tool to target (cm), median", yscale="log", title="one training each, 60 unseen starts")
axes.legend()
plt.show()

# %% [markdown]
# ### 目标周围学到的奖励
#
# 取示范者在目标处悬停的一个时刻，把目标从工具处移开，前后上下最多 20 cm。*飞向目标*，判别器给多少奖励？*停留*又给多少？`reward_along(run, episode)` 给出沿一次记录的飞行的奖励，所以我们交给它一次虚构的飞行，每一步对应图上的一个位置。

# %%
from aerial_il.algorithms.adversarial.reward_net import reward_along

moment, far = demos[0], np.linspace(-0.2, 0.2, 33)
offset = np.stack(np.meshgrid(far, far), axis=-1).reshape(-1, 2)
count = len(offset)


def invented(go):
    """An episode whose step k has the target at the k-th place of the map; its actions go there or stay."""
    obs = {name: np.repeat(values[-2:-1], count + 1, axis=0) for name, values in moment.obs.items() if values.ndim < 3}
    target = obs["ee_pos"].copy()
    target[:count, 0] += offset[:, 0]
    target[:count, 2] += offset[:, 1]
    obs |= {"target_pos": target, "tool_to_target": target - obs["ee_pos"], "target_rot6d": obs["ee_rot6d"].copy()}
    actions = np.repeat(moment.executed_actions[-1:], count, axis=0)
    actions[:, :3], actions[:, 3:9] = (target if go else obs["ee_pos"])[:count], obs["ee_rot6d"][:count]
    return replace(moment, obs=obs, actions=actions, executed_actions=actions, expert_actions=np.full_like(actions, np.nan))


figure, axes = plt.subplots(1, 4, figsize=(14.5, 3.4), layout="constrained")
k = 0
for name in ("GAIL", "control: random actions"):
    reward, interface = load_reward(f"reach_{list(kinds).index(name)}")
    for go in (True, False):
        paid = reward.along(invented(go), interface).reshape(33, 33)
        picture = axes[k].pcolormesh(100 * far, 100 * far, paid, cmap="viridis")
        figure.colorbar(picture, ax=axes[k], shrink=0.8)
        axes[k].plot(0, 0, "x", color="C1")
        axes[k].set(title=f"{name.partition(':')[0]}: {'go' if go else 'stay'}", xlabel="target ahead by (cm)", ylabel="above by (cm)", aspect="equal")
        k += 1
plt.show()
along = np.mean([reward_along("reach_1", one) for one in list(demos)[:5]], axis=0)
print(f"paid along demonstrations: {along[:25].mean():.2f} in the first half second, {along[-50:].mean():.2f} in the last second; where D is one half: {np.log(2):.2f}")
last = analysis.metrics("reach_1").dropna(subset=["reward/acc_expert"]).iloc[-1]
print(f"of the last rollout, recognised: {100 * last['reward/acc_expert']:.0f} % of demonstrated pairs, {100 * last['reward/acc_agent']:.0f} % of flown ones")

# %%
if can_render():
    states = hovers["GAIL"][2][:150]
    with SceneRenderer(worlds.model_xml) as scene:
        view = scene.frame(states[::30], 1.5)
        pictures = [Image.fromarray(scene.draw(state, view, 180, 270)).quantize(40) for state in states[::10]]
    kept = io.BytesIO()
    pictures[0].save(kept, "GIF", save_all=True, append_images=pictures[1:], duration=200, loop=0)
    display(Film(data=kept.getvalue(), format="gif"))  # noqa: F821  (the notebook's own)
worlds.close()
env.close()

# %% [markdown]
# 怎样解读。先看距离的曲线：在这次运行中，单独的克隆策略解决了全部 60 个起始状态，从它继续学的 GAIL 也解决了全部 60 个，最后并没有更近。用随机动作的对照飞走了。所以这里克隆策略已经够用，GAIL 增加的只是那个奖励。
#
# 奖励又如何？当学习者与示范者几乎一样好时，可供区分的已所剩无几。在最后一批飞行中，判别器对两边都只认出一半多一点；而在示范者悬停于目标处时，它支付 0.70：$-\log(1-\tfrac12)=0.69$，正如 7.3 所说，二者没有区别的地方必然如此。这些图在目标处没有峰值；其中的坡度是残余，与对照的斜面一样。**这不是"到目标处去"的图，也不应该是**：它说的是训练结束时，飞行与示范之间还剩下什么差别。谁需要目的本身，就必须另外去问：只依赖于状态的奖励（AIRL），行为与目的相互分离的数据（另一种风，7.1），或者示范者的一句话。
#
# ## 7.5 可以记住什么
#
# - 从示范中学到的奖励只确定到相差一个塑形项为止，而且只在示范或飞行到过的地方有意义。使用之前先看一看：`aerial-il reward RUN dataset=...` 沿一次飞行画出它，本篇在一张图上画出它。
# - 在 `reach` 上，只要不让网络看到机器人在世界中的位置，克隆策略就够用了。研究 [experiments/gail](../../experiments/gail/README.md)（各三次训练，每次飞行 100 次）的结果相同：从克隆策略开始的 GAIL 为 100 %（98.7–100），单独的克隆策略为 100 %（98.7–100），用随机示范的 GAIL 为 0（一次训练）。在 `pick_place` 上二者都没有学会：2.3 %（1.1–4.7）和 1.7 %（0.7–3.8）。
# - 如果克隆策略*不够*，飞行就有帮助：用十次 Hopper 示范，从克隆策略开始的 DAC（异策略的 GAIL，`algorithm=dac`）达到专家回报的 0.994（对飞行 0.988–0.998，对训练 0.994–0.995），单独的克隆策略为 0.906（0.883–0.928；0.675–1.137）。用随机示范的对照为 0.007（一次训练）。
# - 每个结果旁边都要报告克隆策略和对照。[全部算法及其设置](../../docs/adversarial.md)。
#
# **出处。** Ng、Harada 与 Russell，"Policy invariance under reward transformations"，*ICML* 1999。Ziebart 等，"Maximum entropy inverse reinforcement learning"，*AAAI* 2008；Ziebart，博士论文，2010。Ho 与 Ermon，"Generative adversarial imitation learning"，*NeurIPS* 2016。Fu、Luo 与 Levine，"Learning robust rewards with adversarial inverse reinforcement learning"，*ICLR* 2018。Kostrikov 等，"Discriminator-actor-critic"，*ICLR* 2019。Orsini 等，"What matters for adversarial imitation learning?"，*NeurIPS* 2021。
