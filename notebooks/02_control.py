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
# # 2. From PID to LQR to geometric control, with an arm that moves
#
# A quadrotor with an arm is a machine that stands on its own thrust and whose weight moves. This notebook derives what its
# controller has to know (rotations, the arm's geometry, the equations of motion), and then flies four control laws of this
# project under the same conditions, with the arm at rest and with the arm swinging.
#
# You need: linear algebra, Newton's laws, and a little Python. Everything can be read without running it.

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
# ## 2.1 Rotations and transforms
#
# A vector has different coordinates in different frames. Let $R$ be the matrix whose columns are the axes of the vehicle's base
# (x forward, y left, z up), written in world coordinates. Then
#
# $$ v^{\text{world}} = R\, v^{\text{base}}, \qquad R^\top R = I, \quad \det R = 1 . $$
#
# All such matrices form the group $SO(3)$. A *pose* is a rotation and a position, $T = (R, p)$; poses compose as
# $(R_1,p_1)(R_2,p_2) = (R_1R_2,\; R_1p_2+p_1)$. That is all there is to a kinematic chain: multiply poses from the base to the tool.
#
# Rotation about a unit axis $a$ by an angle $q$ is Rodrigues' formula, with $\hat a$ the matrix for which $\hat a v = a\times v$:
#
# $$ R(a,q) = I + \sin q\;\hat a + (1-\cos q)\;\hat a^2 . $$
#
# How does $R$ change in time? Differentiate $R^\top R=I$: $R^\top\dot R$ is antisymmetric, so there is a vector $\omega$, the body
# rate, with
#
# $$ \dot R = R\,\hat\omega . $$
#
# Source: Murray, Li & Sastry, *A Mathematical Introduction to Robotic Manipulation* (1994), ch. 2.


# %%
def hat(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation(axis, angle):
    return np.eye(3) + np.sin(angle) * hat(axis) + (1 - np.cos(angle)) * hat(axis) @ hat(axis)


turn = rotation(np.array([0.0, 1.0, 0.0]), 0.3)
print("orthonormal to", np.abs(turn.T @ turn - np.eye(3)).max(), " determinant", np.linalg.det(turn))

# %% [markdown]
# ## 2.2 The arm: product of rotations, and Denavit-Hartenberg
#
# In this project every link's frame is aligned with the base when all joints are at zero. Joint $j$ sits at $o_j$ in the frame of
# the link before it, and turns about $a_j$. The tool, at $t$ in the last link, is then at
#
# $$ R_j = R_{j-1} R(a_j, q_j), \qquad p_j = p_{j-1} + R_{j-1} o_j, \qquad p_{\text{tool}} = p_J + R_J\, t . $$
#
# The classical convention of Denavit & Hartenberg (*ASME J. Appl. Mech.* 1955; here in Craig's form, *Introduction to Robotics*,
# eq. 3.6) needs four numbers per joint instead of six. The z axis of frame $j$ is the joint's axis, the x axis points along the
# common normal to the next axis, and
#
# $$ {}^{j-1}T_j = \operatorname{Rot}_x(\alpha_{j-1})\operatorname{Trans}_x(a_{j-1})\operatorname{Rot}_z(\theta_j)\operatorname{Trans}_z(d_j). $$
#
# Both say the same. The cell below computes the tool of our arm in both ways. The first joint rolls about x and the other three
# pitch about parallel axes, so that the table is short (link $j$ stands for its length):
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
# ## 2.3 Newton and Euler for a quadrotor
#
# Let $p$ be the centre of mass, $m$ the mass, $J$ the inertia about it. Rotor $i$ at $r_i$ pushes with $f_i\ge0$ along $n_i$ and
# twists with $k_i f_i$ about it. Newton's law in the world and Euler's in the body are
#
# $$ m\,\ddot p = -m g\,e_3 + R\,F, \qquad J\dot\omega = -\,\omega\times J\omega + \tau, $$
#
# $$ \begin{pmatrix}F\\ \tau\end{pmatrix} = \sum_i \begin{pmatrix} n_i\\ r_i\times n_i + k_i n_i\end{pmatrix} f_i = W f . $$
#
# With all $n_i = e_3$, $W$ has rank four: one force and three torques. The vehicle is *under-actuated*: it cannot push sideways,
# and has to lean, $\ddot p_{xy} \approx g\,(\theta, -\phi)$. Position therefore hangs behind attitude: four integrators from a torque
# to a place. (Mahony, Kumar & Corke, "Multirotor Aerial Vehicles", *IEEE RAM* 2012, eq. 1 to 6.)

# %%
wrench = np.vstack([vehicle.rotor_axis.T, (np.cross(vehicle.rotor_pos, vehicle.rotor_axis) + vehicle.rotor_drag_ratio[:, None] * vehicle.rotor_axis).T])
print("W =\n", wrench.round(3))
print("rank", np.linalg.matrix_rank(wrench))

# %% [markdown]
# ## 2.4 What the arm does to the base
#
# With links of mass $m_j$ whose centres are at $c_j(q)$, the common centre of mass is
#
# $$ c(q) = \frac{1}{m}\sum_j m_j\, c_j(q), \qquad m = m_0 + \sum_j m_j . $$
#
# It moves with the posture. Three things follow.
#
# 1. *Static torque.* The rotors act about the base's origin; to hover, they must balance $\tau = c(q) \times m g e_3$.
# 2. *Reaction.* The total angular momentum only changes by outer torques: accelerate the arm and the base is pushed back.
# 3. *Changed inertia.* $J(q)$ grows as the arm stretches.
#
# In formulas, for the state $\xi=(p,R,q)$ with velocities $\nu$, all of it is $M(\xi)\dot\nu + h(\xi,\nu) = (F,\tau,\tau_q)$, where the
# off-diagonal blocks of $M$ are the coupling. The geometric controller below computes it by recursive Newton-Euler (Featherstone,
# *Rigid Body Dynamics Algorithms*, 2008, ch. 5). The textbook laws ignore it.

# %%
for stance in stances(robot):
    torque = np.cross(stance.com, [0, 0, vehicle.mass * GRAVITY])
    print(f"{stance.name:16s} centre of mass {100 * stance.com[0]:5.2f} cm ahead, pitch torque {torque[1]:+.3f} N m, "
          f"J_yy {1e3 * stance.inertia[1]:.1f}e-3 kg m², rotors {stance.thrust.round(1)} N")

# %% [markdown]
# ## 2.5 PID: feedback without a model
#
# With the error $e = p_{ref}-p$, ask for an acceleration, turn it into a lean, and the lean into a torque:
#
# $$ a = \ddot p_{ref} + k_p e + k_v \dot e + k_i\!\int\! e, \quad \theta_d = \frac{a_x}{g},\ \phi_d=-\frac{a_y}{g}\ (\psi=0), \quad
#    \tau = J_0\,(k_R e_\theta - k_\omega \omega + k_I\!\int\! e_\theta). $$
#
# Without the integral, a constant disturbance $d$ leaves the offset $e = d/(m k_p)$; the integral removes it, slowly. As the
# position loop is $\ddot e + k_v\dot e + k_p e = 0$, the gains are a frequency and a damping: $\omega_0=\sqrt{k_p}$,
# $\zeta = k_v/2\sqrt{k_p}$. With the 20 and 9.8 used here, $\omega_0=4.5$ rad/s, $\zeta=1.1$.
# Code: `aerial_il/control/controllers/pid.py`.
#
# ## 2.6 LQR: gains from a model and a price
#
# Linearise 2.3 about level hover, $\dot x = Ax+Bu$, and minimise $\int x^\top Qx + u^\top R u\,dt$. Try the value function
# $V(x)=x^\top P x$ in the Hamilton-Jacobi-Bellman equation $0=\min_u\,[x^\top Qx+u^\top Ru+\nabla V^\top(Ax+Bu)]$. The minimum is at
#
# $$ u=-R^{-1}B^\top P\,x = -Kx, \qquad\text{and}\qquad A^\top P+PA-PBR^{-1}B^\top P+Q=0 , $$
#
# the algebraic Riccati equation (Bryson & Ho, *Applied Optimal Control*, 1975, ch. 5). $Q$ and $R$ follow Bryson's rule: one over the
# square of what is still acceptable. Code: `aerial_il/control/controllers/lqr.py`.

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
# ## 2.7 Geometric control on SE(3)
#
# PID and LQR measure attitude by roll, pitch and yaw: fine near level, wrong far from it. Lee, Leok & McClamroch (*CDC* 2010) measure
# the error on the group itself. Build the wanted attitude $R_d$ from the wanted force: its z axis along $F_d$, its x axis towards the
# heading. Then, with $(\cdot)^\vee$ the inverse of the hat,
#
# $$ e_R = \tfrac12\,(R_d^\top R - R^\top R_d)^\vee, \qquad e_\omega = \omega - R^\top R_d\,\omega_d , \qquad
#    \tau = -k_R e_R - k_\omega e_\omega + \omega\times J\omega + \dots $$
#
# Why does it work? $\Psi=\tfrac12\operatorname{tr}(I-R_d^\top R)$ is zero only at $R=R_d$ and below 2 for errors below 180°. For
# $V=\tfrac12 e_\omega\!\cdot\! Je_\omega + k_R\Psi$, and a fixed $R_d$, $\dot\Psi=e_R\cdot e_\omega$, and therefore
# $\dot V=-k_\omega|e_\omega|^2\le0$. The cell checks $\dot\Psi=e_R\cdot e_\omega$ by differences.
#
# Here the gains multiply accelerations, and the wrench comes from the inverse dynamics of base *and* arm (2.4): the moving centre of
# mass is fed forward. `geometric_observer`, the default, adds an observer: what the momentum does beyond what rotors and gravity
# explain is taken for a disturbance, and subtracted (De Luca & Mattone, *ICRA* 2003). Code: `aerial_il/control/flight.py`.

# %%
wanted, now, rate = rotation(np.array([1.0, 0, 0]), 0.4), rotation(np.array([0.6, 0.8, 0]), 1.9), np.array([0.3, -1.0, 0.5])
psi = lambda r: 0.5 * np.trace(np.eye(3) - wanted.T @ r)
error = 0.5 * (wanted.T @ now - now.T @ wanted)
e_R = np.array([error[2, 1], error[0, 2], error[1, 0]])
h = 1e-6
by_differences = (psi(now @ rotation(rate / np.linalg.norm(rate), h * np.linalg.norm(rate))) - psi(now)) / h
print("dΨ/dt by differences", by_differences.round(5), " by formula", (e_R @ rate).round(5))

# %% [markdown]
# ## 2.8 Flown: the same conditions for four laws
#
# The base is commanded directly (`base_joint`: base position, yaw, joint angles), in calm air, from the same four seeds (10000 to
# 10003). Both flights last 10 s. First the base is to hold its place while the arm swings between its two rest postures, once every
# two seconds. Then its reference moves by 1 m at up to the controller's reference speed, the arm at rest.

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
# ## 2.9 What to take home, and what surprises
#
# - `lqr` swings with the arm, 2 cm and more: it balances the arm at rest, has no integrator, and leaves an offset wherever the arm
#   is not at its hover point. This is what theory says.
# - `pid` knows nothing of the arm and begins worst (1.9 cm in the first swing). Its integrators then learn the mean push, and at the
#   end it is the *best* of the four. A slow, repeated disturbance is what integrators are made for; in a single quick motion, or with
#   wind and contact, the order can be another.
# - The geometric laws feed the arm's weight and the moving centre of mass forward: their error swings by 0.8 cm, a third of LQR's.
#   But its mean is not zero: they hold the base some 0.7 cm too high. The controller flies on noisy sensors, its commands jitter with
#   them, and rotors speed up faster than they slow down: jitter lifts. (With `tier="calm-noise"` the base is where it should be.) An
#   integrator of position removes it. The observer looks for forces that the measured thrusts do not explain, and there is none.
#   Up to 0.6 cm sideways is the same under all laws.
# - The step overshoots by 14 cm under all laws alike: the reference runs at constant speed and stops at once, and a vehicle that has
#   to lean cannot. A planner that brakes (as the one for tool poses does) is worth more than any gain.
#
# The lesson is not that one law wins. Say which disturbance, how long, how often, and measure. This was one robot in calm air with
# four seeds; `aerial-il bench controllers` measures steps, gusts and the tool on all robots, and `docs/controllers.md` has the tables.
#
# Try: `tier="gusts"` in `fly`; another robot (`fa_hexa_arm4` pushes sideways without leaning); a faster swing.
