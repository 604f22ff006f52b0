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
# # 2. 从 PID 到 LQR 再到几何控制：机械臂在动的时候
#
# 带机械臂的四旋翼靠自己的推力悬在空中，而它的重量还会移动。本篇先推导控制器必须知道的东西（旋转、机械臂的几何、运动方程），再让本项目的四种控制律在完全相同的条件下飞行：机械臂静止时，以及机械臂摆动时。
#
# 预备知识：线性代数、牛顿定律、一点 Python。不运行代码也能读完全篇。

# %%
import io

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Image as Film
from PIL import Image

import aerial_il
from aerial_il import robots
from aerial_il.control.hover import hover_body
from aerial_il.control.controllers.lqr import feedback_matrix, hover_model
from aerial_il.core.rendering import can_render
from aerial_il.robots.figures import chain, stances

robot = robots.get("ua_quad_arm4")
vehicle = robot.vehicle
GRAVITY = 9.81
print(f"{robot.name}: {vehicle.mass:.2f} kg, {robot.num_rotors} rotors, {robot.num_joints} joints")

# %% [markdown]
# ## 2.1 旋转与坐标变换
#
# 同一个向量在不同坐标系里坐标不同。设矩阵 $R$ 的各列是机体坐标轴（x 向前、y 向左、z 向上）在世界系中的坐标，则
#
# $$ v^{\text{world}} = R\, v^{\text{base}}, \qquad R^\top R = I, \quad \det R = 1 . $$
#
# 所有这样的矩阵构成群 $SO(3)$。*位姿*由旋转与位置组成，$T = (R, p)$；位姿的复合为 $(R_1,p_1)(R_2,p_2) = (R_1R_2,\; R_1p_2+p_1)$。运动链无非如此：从机体到工具，把位姿逐个相乘。
#
# 绕单位轴 $a$ 转过角度 $q$ 由罗德里格斯公式给出，其中 $\hat a$ 是满足 $\hat a v = a\times v$ 的反对称矩阵：
#
# $$ R(a,q) = I + \sin q\;\hat a + (1-\cos q)\;\hat a^2 . $$
#
# $R$ 怎样随时间变化？对 $R^\top R=I$ 求导可知 $R^\top\dot R$ 反对称，因此存在向量 $\omega$（机体角速度），使
#
# $$ \dot R = R\,\hat\omega . $$
#
# 出处：Murray、Li、Sastry，*A Mathematical Introduction to Robotic Manipulation*（1994），第 2 章。


# %%
def hat(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation(axis, angle):
    return np.eye(3) + np.sin(angle) * hat(axis) + (1 - np.cos(angle)) * hat(axis) @ hat(axis)


turn = rotation(np.array([0.0, 1.0, 0.0]), 0.3)
print("orthonormal to", np.abs(turn.T @ turn - np.eye(3)).max(), " determinant", np.linalg.det(turn))

# %% [markdown]
# ## 2.2 机械臂：旋转连乘与 Denavit–Hartenberg 参数
#
# 本项目约定：所有关节为零时，每个连杆的坐标系都与机体坐标系平行。关节 $j$ 位于前一连杆坐标系中的 $o_j$，绕 $a_j$ 转动；工具位于末连杆坐标系中的 $t$。于是
#
# $$ R_j = R_{j-1} R(a_j, q_j), \qquad p_j = p_{j-1} + R_{j-1} o_j, \qquad p_{\text{tool}} = p_J + R_J\, t . $$
#
# Denavit 与 Hartenberg 的经典约定（*ASME J. Appl. Mech.* 1955；此处采用 Craig 的形式，*Introduction to Robotics* 式 3.6）每个关节只需四个数，而不是六个。坐标系 $j$ 的 z 轴取关节轴，x 轴取到下一关节轴的公垂线方向：
#
# $$ {}^{j-1}T_j = \operatorname{Rot}_x(\alpha_{j-1})\operatorname{Trans}_x(a_{j-1})\operatorname{Rot}_z(\theta_j)\operatorname{Trans}_z(d_j). $$
#
# 两种写法等价。下面的代码用两种方法计算同一机械臂的工具位置。第一个关节绕 x 轴滚转，其余三个绕平行轴俯仰，所以参数表很短（"link $j$"表示该连杆的长度）：
#
# | $j$ | $\alpha_{j-1}$ | $a_{j-1}$ | $\theta_j$ | $d_j$ |
# |---|---|---|---|---|
# | 1 | 0 | 0 | $q_1$ | link 1 |
# | 2 | $\pi/2$ | 0 | $q_2+\pi/2$ | 0 |
# | 3 | 0 | link 2 | $q_3$ | 0 |
# | 4 | 0 | link 3 | $q_4$ | 0 |


# %%
def tool_by_rotations(q):
    rot, pos = np.eye(3), np.zeros(3)
    for offset, axis, angle in zip(vehicle.link_offset, vehicle.link_axis, q, strict=True):
        pos, rot = pos + rot @ offset, rot @ rotation(axis, angle)
    return pos + rot @ vehicle.tool_offset


def dh(alpha, a, theta, d):
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -sa * d], [st * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]])


def tool_by_dh(q):
    frame = np.eye(4)  # frame 0: z along the vehicle's x, about which joint 1 rolls; x along its z
    frame[:3, :3], frame[:3, 3] = np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]]), robot.arm.mount
    lengths = [link.tip[0] for link in robot.arm.links]
    table = [(0, 0, q[0], lengths[0]), (np.pi / 2, 0, np.pi / 2 + q[1], 0), (0, lengths[1], q[2], 0), (0, lengths[2], q[3], 0)]
    for row in table:
        frame = frame @ dh(*row)
    return (frame @ np.array([vehicle.tool_offset[0], 0, 0, 1]))[:3]


rng = np.random.default_rng(0)
errors = []
for q in rng.uniform(vehicle.joint_low, vehicle.joint_high, (1000, 4)):
    exact = robot.tool_at(q)[0]  # what the flying controller uses
    errors.append([np.abs(tool_by_rotations(q) - exact).max(), np.abs(tool_by_dh(q) - exact).max()])
print("largest difference to the controller's own tool position, m:", np.max(errors, axis=0))

# %%
figure, axes = plt.subplots(figsize=(4.5, 4))
for name, posture, colour in (("tool ahead", robot.rest_forward, "tab:orange"), ("tool down", robot.rest_down, "tab:blue")):
    joints = chain(robot, np.array(posture))
    axes.plot(joints[:, 0], joints[:, 2], "o-", color=colour, label=name)
axes.plot([-0.25, 0.25], [0, 0], color="black", linewidth=4, label="base")
axes.set(xlabel="x, forward (m)", ylabel="z, up (m)", aspect="equal", title="the arm below its base")
axes.legend()
figure.tight_layout()
plt.show()

# %% [markdown]
# ## 2.3 四旋翼的牛顿–欧拉方程
#
# 设 $p$ 为质心，$m$ 为质量，$J$ 为绕质心的转动惯量。旋翼 $i$ 位于 $r_i$，沿 $n_i$ 产生推力 $f_i\ge0$，并绕该轴产生反扭矩 $k_i f_i$。世界系中的牛顿定律与机体系中的欧拉方程为
#
# $$ m\,\ddot p = -m g\,e_3 + R\,F, \qquad J\dot\omega = -\,\omega\times J\omega + \tau, $$
#
# $$ \begin{pmatrix}F\\ \tau\end{pmatrix} = \sum_i \begin{pmatrix} n_i\\ r_i\times n_i + k_i n_i\end{pmatrix} f_i = W f . $$
#
# 当所有 $n_i = e_3$ 时，$W$ 的秩为四：一个力、三个力矩。飞行器是*欠驱动*的：它不能直接侧向推，只能倾斜，$\ddot p_{xy} \approx g\,(\theta, -\phi)$。因此位置排在姿态之后：从力矩到位置要经过四次积分。（Mahony、Kumar、Corke，"Multirotor Aerial Vehicles"，*IEEE RAM* 2012，式 1 至 6。）

# %%
wrench = np.vstack([vehicle.rotor_axis.T, (np.cross(vehicle.rotor_pos, vehicle.rotor_axis) + vehicle.rotor_drag_ratio[:, None] * vehicle.rotor_axis).T])
print("W =\n", wrench.round(3))
print("rank", np.linalg.matrix_rank(wrench))

# %% [markdown]
# ## 2.4 机械臂对机体的影响
#
# 设各连杆质量为 $m_j$、质心为 $c_j(q)$，则整机质心为
#
# $$ c(q) = \frac{1}{m}\sum_j m_j\, c_j(q), \qquad m = m_0 + \sum_j m_j . $$
#
# 它随机械臂的姿态移动，由此有三个后果：
#
# 1. *静力矩*。旋翼相对机体原点起作用；悬停时必须平衡 $\tau = c(q) \times m g e_3$。
# 2. *反作用*。总角动量只因外力矩改变：机械臂加速，机体就被反推。
# 3. *惯量变化*。机械臂伸展时 $J(q)$ 增大。
#
# 写成方程：状态 $\xi=(p,R,q)$、速度 $\nu$ 满足 $M(\xi)\dot\nu + h(\xi,\nu) = (F,\tau,\tau_q)$，$M$ 的非对角块就是耦合。下文的几何控制器用递推牛顿–欧拉法计算它（Featherstone，*Rigid Body Dynamics Algorithms*，2008，第 5 章）；教科书式的控制律则不考虑它。

# %%
for stance in stances(robot):
    torque = np.cross(stance.com, [0, 0, vehicle.mass * GRAVITY])
    print(f"{stance.name:16s} centre of mass {100 * stance.com[0]:5.2f} cm ahead, pitch torque {torque[1]:+.3f} N m, "
          f"J_yy {1e3 * stance.inertia[1]:.1f}e-3 kg m², rotors {stance.thrust.round(1)} N")

# %% [markdown]
# ## 2.5 PID：不需要模型的反馈
#
# 设误差 $e = p_{ref}-p$。先求期望加速度，再换算成倾角，再换算成力矩：
#
# $$ a = \ddot p_{ref} + k_p e + k_v \dot e + k_i\!\int\! e, \quad \theta_d = \frac{a_x}{g},\ \phi_d=-\frac{a_y}{g}\ (\psi=0), \quad
#    \tau = J_0\,(k_R e_\theta - k_\omega \omega + k_I\!\int\! e_\theta). $$
#
# 没有积分项时，恒定扰动 $d$ 会留下稳态误差 $e = d/(m k_p)$；积分项会慢慢把它消除。位置环为 $\ddot e + k_v\dot e + k_p e = 0$，所以增益就是频率与阻尼：$\omega_0=\sqrt{k_p}$，$\zeta = k_v/2\sqrt{k_p}$。这里取 20 与 9.8，即 $\omega_0=4.5$ rad/s，$\zeta=1.1$。代码：`aerial_il/control/controllers/pid.py`。
#
# ## 2.6 LQR：由模型和代价得到增益
#
# 把 2.3 在水平悬停处线性化，$\dot x = Ax+Bu$，并最小化 $\int x^\top Qx + u^\top R u\,dt$。把值函数 $V(x)=x^\top P x$ 代入哈密顿–雅可比–贝尔曼方程 $0=\min_u\,[x^\top Qx+u^\top Ru+\nabla V^\top(Ax+Bu)]$，最小值在
#
# $$ u=-R^{-1}B^\top P\,x = -Kx, \qquad\text{且}\qquad A^\top P+PA-PBR^{-1}B^\top P+Q=0 , $$
#
# 后者就是代数黎卡提方程（Bryson、Ho，*Applied Optimal Control*，1975，第 5 章）。$Q$ 与 $R$ 按 Bryson 规则选取：可接受误差平方的倒数。代码：`aerial_il/control/controllers/lqr.py`。

# %%
body = hover_body(vehicle)
A, B = hover_model(body.mass, body.inertia)
K = feedback_matrix(vehicle)
poles = np.linalg.eigvals(A - B @ K)
print("pitch torque per m of x, m/s, rad of pitch, rad/s:", K[4, [0, 3, 7, 10]].round(3))
figure, axes = plt.subplots(figsize=(4.5, 3.6))
axes.axvline(0, color="0.7")
axes.scatter(poles.real, poles.imag, marker="x", color="tab:red")
axes.set(xlabel="real part (1/s)", ylabel="imaginary part (rad/s)", title="poles of hover under LQR: all to the left")
figure.tight_layout()
plt.show()
print("slowest pole:", poles.real.max().round(2), "1/s")

# %% [markdown]
# ## 2.7 SE(3) 上的几何控制
#
# PID 与 LQR 用滚转、俯仰、偏航角来度量姿态：接近水平时没问题，远离水平就不对了。Lee、Leok、McClamroch（*CDC* 2010）直接在群上度量误差。由期望力构造期望姿态 $R_d$：z 轴沿 $F_d$，x 轴朝向期望航向。记 $(\cdot)^\vee$ 为 hat 的逆运算，则
#
# $$ e_R = \tfrac12\,(R_d^\top R - R^\top R_d)^\vee, \qquad e_\omega = \omega - R^\top R_d\,\omega_d , \qquad
#    \tau = -k_R e_R - k_\omega e_\omega + \omega\times J\omega + \dots $$
#
# 为什么有效？$\Psi=\tfrac12\operatorname{tr}(I-R_d^\top R)$ 仅在 $R=R_d$ 时为零，误差小于 180° 时小于 2。取 $V=\tfrac12 e_\omega\!\cdot\! Je_\omega + k_R\Psi$，当 $R_d$ 固定时 $\dot\Psi=e_R\cdot e_\omega$，于是 $\dot V=-k_\omega|e_\omega|^2\le0$。下面的代码用差分验证 $\dot\Psi=e_R\cdot e_\omega$。
#
# 在本项目中增益乘的是加速度，力与力矩来自机体*与*机械臂的逆动力学（2.4）：移动的质心被前馈补偿。默认的 `geometric_observer` 另加一个观测器：动量的变化中旋翼与重力解释不了的部分被视为扰动并减去（De Luca、Mattone，*ICRA* 2003）。代码：`aerial_il/control/flight.py`。

# %%
wanted, now, rate = rotation(np.array([1.0, 0, 0]), 0.4), rotation(np.array([0.6, 0.8, 0]), 1.9), np.array([0.3, -1.0, 0.5])
psi = lambda r: 0.5 * np.trace(np.eye(3) - wanted.T @ r)
error = 0.5 * (wanted.T @ now - now.T @ wanted)
e_R = np.array([error[2, 1], error[0, 2], error[1, 0]])
h = 1e-6
by_differences = (psi(now @ rotation(rate / np.linalg.norm(rate), h * np.linalg.norm(rate))) - psi(now)) / h
print("dΨ/dt by differences", by_differences.round(5), " by formula", (e_R @ rate).round(5))

# %% [markdown]
# ## 2.8 实飞：同样条件下的四种控制律
#
# 直接指挥机体（`base_joint`：机体位置、偏航、关节角），无风，四个相同的种子（10000 至 10003），每次飞行 10 s。第一种飞行：机体保持原位，机械臂在两个静止姿态之间每两秒摆动一次。第二种飞行：机械臂静止，参考位置以控制器的参考速度前移 1 m。

# %%
LAWS = ("pid", "lqr", "geometric", "geometric_observer")
SEEDS, STEPS, DT = 4, 500, 0.02
DOWN, AHEAD = np.array(robot.rest_down), np.array(robot.rest_forward)


def fly(law, command, tier="calm", film=False):
    """Base errors (steps, seeds, 3) in m, joint angles (steps, seeds, 4), pictures."""
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=SEEDS, action="base_joint", controller=law, tier=tier, num_threads=2)
    obs = env.reset(10_000)
    home, heading = obs["base_pos"].copy(), np.arctan2(obs["base_rot6d"][:, 1], obs["base_rot6d"][:, 0])
    start, errors, angles, pictures = obs["joint_pos"].copy(), [], [], []
    for k in range(STEPS):
        shift, posture, share = command(k * DT)
        joints = start + share * (posture - start)
        action = np.column_stack([home + shift, heading, joints, np.ones(SEEDS)])
        obs = env.step(action).obs
        errors.append(home + shift - obs["base_pos"])
        angles.append(obs["joint_pos"].copy())
        if film and k % 10 == 0 and can_render():
            pictures.append(Image.fromarray(env.render(0, "scene", 180, 240)))
    env.close()
    return np.array(errors), np.array(angles), pictures


def swing(t):
    phase = 0.5 - 0.5 * np.cos(np.pi * t)
    return np.zeros(3), DOWN + phase * (AHEAD - DOWN), min(1.0, t)


def step(t):
    return np.array([1.0 if t >= 2.0 else 0.0, 0, 0]), DOWN, min(1.0, t)


swung = {law: fly(law, swing, film=law == "geometric_observer") for law in LAWS}
stepped = {law: fly(law, step) for law in LAWS}

# %%
time = DT * np.arange(STEPS)
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6))
for law in LAWS:
    left.plot(time, 100 * np.linalg.norm(swung[law][0], axis=2).mean(axis=1), label=law)
    right.plot(time, 1 - stepped[law][0][:, :, 0].mean(axis=1) - (time < 2.0), label=law)
left.set(xlabel="time (s)", ylabel="base off its place (cm)", title="arm swings, base is to stay (mean of 4 seeds)")
right.set(xlabel="time (s)", ylabel="x moved (m)", title="base is sent 1 m ahead at 2 s")
left.legend()
figure.tight_layout()
plt.show()

# %%
print(f"{'law':20s} {'arm swings: RMS':>16s} {'largest':>9s}   {'1 m ahead: overshoot':>20s} {'error at the end':>17s}")
for law in LAWS:
    late = 100 * np.linalg.norm(swung[law][0][100:], axis=2)
    moved = stepped[law][0][100:, :, 0]
    print(f"{law:20s} {np.sqrt((late**2).mean()):13.2f} cm {late.max():6.2f} cm   {100 * max(0.0, -moved.min()):17.2f} cm "
          f"{100 * np.abs(stepped[law][0][-50:]).mean():14.2f} cm")

# %%
if swung["geometric_observer"][2]:
    pictures, kept = swung["geometric_observer"][2], io.BytesIO()
    small = [picture.quantize(48) for picture in pictures[5:30]]
    small[0].save(kept, format="GIF", save_all=True, append_images=small[1:], duration=200, loop=0)
    display(Film(data=kept.getvalue(), format="gif"))  # noqa: F821  (the notebook's own)

# %% [markdown]
# ## 2.9 结论，以及意外
#
# - `lqr` 随机械臂摆动，误差 2 cm 以上：它只为静止的机械臂配平，又没有积分项，机械臂一离开悬停点就留下偏差。这与理论一致。
# - `pid` 对机械臂一无所知，开头最差（第一次摆动 1.9 cm）。但积分项逐渐学会了平均的推力，最后反而是四者中*最好*的。缓慢而重复的扰动正是积分项的用武之地；若只有一次快速动作，或者有风、有接触，名次可能不同。
# - 几何控制律把机械臂的重量和移动的质心前馈补偿：误差的摆幅为 0.8 cm，是 LQR 的三分之一。但均值不为零：它们让机体高出约 0.7 cm。控制器依靠带噪声的传感器，指令随之抖动，而旋翼加速比减速快：抖动产生额外升力（用 `tier="calm-noise"` 时机体不再偏高）。位置积分项可消除它；观测器寻找的是测得推力无法解释的力，而这里没有这样的力。水平方向至多 0.6 cm 的误差在各控制律下相同。
# - 阶跃响应在所有控制律下都超调约 14 cm：参考点匀速前进后突然停住，而必须倾斜才能减速的飞行器做不到。会刹车的规划器（工具位姿的规划器就是这样）比任何增益都管用。
#
# 教训不是某一种控制律获胜，而是：说清是什么扰动、多久、多频繁，然后去测量。这里只有一个机器人、无风、四个种子；`aerial-il bench controllers` 在所有机器人上测量阶跃、阵风和工具误差，表格见 `docs/controllers.md`。
#
# 可以试试：在 `fly` 中用 `tier="gusts"`；换一个机器人（`fa_hexa_arm4` 不倾斜也能侧推）；让机械臂摆得更快。
