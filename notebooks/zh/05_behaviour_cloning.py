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
# # 5. 行为克隆：为什么要预测动作块，为什么一个答案不够
#
# 有人示范过怎么做；从"看到了什么、做了什么"中学会同样去做。这就是监督学习，但它有两个普通监督学习没有的陷阱。示范者会*停顿*，而只看到当前时刻的网络不知道自己已经等了多久。示范者还会用*几种方式*做同一件事，而这几种方式的平均可能哪一种都不是。本篇先用最小的例子分别展示这两个陷阱，再看第一个陷阱在一台抓取方块的机器人上还剩下多少。不运行代码也能读完全篇。

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
# ## 5.1 学到的是什么
#
# 示范是观测与动作的配对 $(o_t, a_t)$。行为克隆寻找在这些配对上平均损失最小的网络 $f_\theta$。假如网络要多大有多大，数据要多少有多少，它会学到什么？对每个 $o$ 它都可以单独作答，而答案取决于损失函数：
#
# $$ \frac{d}{da}\,\mathbb E\,[(a-A)^2\mid o]=2\,(a-\mathbb E[A\mid o])=0 \quad\Rightarrow\quad a=\mathbb E[A\mid o]\ \text{，即均值；} $$
#
# $$ \frac{d}{da}\,\mathbb E\,[\,|a-A|\,\mid o]=P(A<a\mid o)-P(A>a\mid o)=0 \quad\Rightarrow\quad a\ \text{是中位数。} $$
#
# 本项目的策略 `mlp` 采用第二种损失（L1）。如果每个观测只有一个正确动作，均值和中位数就都是这个动作，一切顺利。下文讨论的是正确动作不止一个的情形。
#
# **动作块**（chunk）是一次预测的 $H$ 个动作，$f_\theta(o_t)=(\hat a_t,\dots,\hat a_{t+H-1})$。同一个网络有三种执行方式：
#
# - *newest*：每一步都预测，只执行最新动作块的第一个动作，其余丢弃；
# - *whole*：把 $H$ 个动作全部执行完，再预测下一块；
# - *ensemble*：每一步都预测，执行迄今所有动作块对这一步的加权平均（Zhao 等 2023）。
#
# 预测单个动作的策略就是 $H=1$，此时三者相同。
#
# ## 5.2 一维的停顿
#
# 示范者从 −1 走到 0，在那里等 $D$ 步，再走到 1。网络只看得到位置。在 0 处，它见过 $D$ 次"停"和一次"走"：中位数永远说*停*。动作块在那里会说什么？示范中位于 0 的时刻共有 $D+1$ 个，其中剩余等待不超过 $j$ 步的，在 $j+1$ 步之后已经离开：所占比例为 $(j+1)/(D+1)$。只要这个比例超过一半，即 $j+1>(D+1)/2$，动作块的第 $j$ 个元素（从 0 数起）的中位数就是离开。因此 *whole* 只要动作块比停顿的一半略长就能通过，而只执行第 0 个元素的 *newest* 永远过不去（只要 $D\ge1$）。
#
# 下面的代码精确地计算这件事。没有训练任何网络：对每个位置，预测就是示范动作块的中位数。执行动作块的代码是项目自己的。

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
# 橙色线是推导的结果：动作块长度等于停顿的一半。*whole* 与它一致。*ensemble* 需要的动作块稍长一些：要有足够多的重叠动作块说"走"，它们的平均才会动。*newest* 无论预测多长的动作块都停在原地：**有用的是执行动作块，而不是预测动作块。**
#
# 这个例子是精确的，也过于干净：在整个停顿的 $D$ 步里，位置完全相同，而且没有任何扰动把机器人推开。
#
# ## 5.3 在机器人上
#
# `pick_place`：从桌上拿起方块，放进碗里松开。专家在两指接触方块 3 步之后就提起，比任何人都快。我们再让它先夹住方块 50 步，也就是一秒，然后才提起。除此之外没有任何差别：没有停顿的专家就是对照。网络看不到夹爪的开合程度（这是默认设置：能看到自己过去决定的网络只会重复这些决定）。
#
# 每位专家对应两次训练，都用 80 次示范、2500 步优化：一次预测单个动作，一次预测长度 20 的动作块。后者用三种方式执行，权重完全相同。所有策略都飞同样的 80 个起始状态，没有任何训练用过它们。

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
# 怎样解读。上面一行每幅图有二十次飞行：下降到方块，上升，下降到碗里，再上升。表中给出对飞行次数的置信区间，并与 *single* 做配对检验（McNemar）：有多少个种子是一方解决而另一方没有解决的。
#
# - *newest* 与 *ensemble* 的网络完全相同，每个权重都一样。二者的差别只在于怎样执行动作块。在这次运行中它的表现与 *single* 相当，两者都比执行动作块的两种方式慢，解决的起始状态也更少。
# - *single* 的轨迹说明了发生的事：有些飞行停在方块处，停几秒，或者再也不走。这就是 5.2 里的静止点。但多数飞行通过了它，而且在这次运行中，有停顿时与没有停顿时差不多一样多：悬停的飞行器在等待时也会移动几毫米，而示范中"走"这个动作出现时的位置也有同样大小的差异。只看当前时刻的策略是碰巧被推到这样的位置时离开的，而不是等满了一秒才离开。
# - 所以我们添加的停顿在这里解释不了多少：作为对照的专家几乎不等，"每步重新决定"与"执行动作块"之间也有同样的差距。即使是它的下降、夹取和提起，也会经过下一个指令发生跳变的状态，在那里每一次重新决定都多了一次停下的机会。
# - 这里每种只有**一次训练**、**一批示范**。区间不包含换一批示范带来的变化（第 9 篇），所以表中比较的是这几个策略，而不是几种思想。尤其是，它不能证明单个动作必然失败。
# - 盲目执行完整的动作块也有代价：0.4 秒之内不做任何修正。
#
# ## 5.4 绕过柱子的两条路
#
# 一条由 20 个点组成的路径要绕过一根柱子。示范者从中间附近出发，随意从左边或右边绕过。整条路径就是一个动作块；网络是项目自己的，很小，每个几秒训练完。对照是下面一行：其他都一样，但所有人都从左边走。

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
# 左右两边的平均正好**撞上**柱子，而从来没有人这样示范过。当所有人都走左边时，同样的网络没有问题，所以它既不是太小，也不是没训练好：损失要求的是均值，得到的就是均值。中位数跟随人数较多的一边，因此总走同一边；如果两边人数相等，二者之间的*任何*值都是中位数，因为在那里 $P(A<a)=P(A>a)$。
#
# **gmm** 预测若干个动作块 $\mu_k$ 及其权重 $\pi_k$、标准差 $\sigma_k$，并最大化混合分布的似然。它的梯度说明了为什么结果不是平均：记 $r_k=\pi_k\mathcal N_k(a)/\sum_j\pi_j\mathcal N_j(a)$，即这次示范由模态 $k$ 解释的份额，则
#
# $$ \frac{\partial}{\partial\mu_k}\log\sum_j\pi_j\,\mathcal N(a;\mu_j,\sigma_j^2)=r_k\,\frac{a-\mu_k}{\sigma_k^2} . $$
#
# 一次示范只拉动能解释它的那个模态，不影响其他模态。飞行时抽取一个模态，执行它的均值。
#
# **flow** 学的不是动作，而是方向。抽取噪声 $\epsilon\sim\mathcal N(0,I)$、一次示范 $a$ 和一个时间 $t$；二者之间的点是 $x_t=(1-t)\,\epsilon+t\,a$，网络用平方损失学习那里的速度 $a-\epsilon$。于是它得到的仍是一个均值：$v(x,t)=\mathbb E[a-\epsilon\mid x_t=x]$，但这是对*经过 $x$* 的那些点取的均值。对任意光滑函数 $\varphi$，
#
# $$ \frac{d}{dt}\mathbb E\,\varphi(x_t)=\mathbb E[\nabla\varphi(x_t)\cdot(a-\epsilon)]=\mathbb E[\nabla\varphi(x_t)\cdot v(x_t,t)] , $$
#
# 这正是沿 $\dot x=v(x,t)$ 运动的点所满足的方程。这些点起初服从噪声的分布，因此最终服从示范的分布（Lipman 等 2023）。下图是路径的中点从噪声变为动作的过程：

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
# 这些线起初被拉向中间、也就是均值所在的地方，途中才分开（它们可能相交：每条只是二十个坐标中的一个）。迟迟没有决定的样本可能停在两个模态之间：上面的表统计了这样的路径；每种网络已知会在哪里失败，见[策略一页](../../docs/policies.md)。
#
# 示范很少时，动作块和混合分布都帮不上忙：策略会到达没有人示范过的地方。第 6 篇讲的就是这个。
#
# **出处。** Pomerleau，*NeurIPS* 1988（克隆驾驶员）。Zhao 等，"Learning fine-grained bimanual manipulation with low-cost hardware"，*RSS* 2023（动作块、时间集成）。Bishop，"Mixture density networks"，1994。Lipman 等，"Flow matching for generative modeling"，*ICLR* 2023。Mandlekar 等，"What matters in learning from offline human demonstrations"，*CoRL* 2021。
