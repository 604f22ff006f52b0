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
# # 12. 用脚本驾驶机器人
#
# 连接、解锁、起飞、飞到某处、移动机械臂、降落：几行 Python，在每种链路上都一样。这里的机器人在本进程中仿真；换成 ROS 2 或 MAVLink，只改一个词（[docs/robot_links.md](../../docs/robot_links.md)）。随后用几行脚本代替策略去抓一个方块；最后让链路中断，看机器人自己会做什么。

# %%
import matplotlib.pyplot as plt
import numpy as np

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.link import LinkError, RefusedError

# %% [markdown]
# ## 十行代码
#
# 机器人停在一个托架里：有机械臂就没有装起落架的地方。每个调用以每秒五十次发送设定点，直到完成；两次调用之间机器人收不到设定点，便自己悬停。位置以米计，世界坐标系，z 轴向上；角度以弧度计。

# %%
with aerial_il.vehicle("simulated", robot="fa_hexa_arm4") as vehicle:
    start = vehicle.state
    vehicle.arm()
    vehicle.take_off(0.3)
    vehicle.go_to(np.add(start.position, [0.4, 0.2, 0.5]), heading=0.5)
    vehicle.move_arm(np.add(start.joints, 0.2))
    vehicle.tool_to(np.add(vehicle.state.tool, [0.0, 0.1, 0.1]))
    print("in the air:", vehicle.state.position.round(2), "tool", vehicle.state.tool.round(2))
    vehicle.land()
    print("landed, off by", f"{1000 * np.linalg.norm(vehicle.state.position - start.position):.0f} mm", "after", f"{vehicle.state.time_s - start.time_s:.1f} s")

# %% [markdown]
# 机器人做不到的，它会拒绝并说明原因；状态不会因此改变。

# %%
with aerial_il.vehicle(robot="ua_quad_arm4") as vehicle:
    for attempt in (vehicle.take_off, vehicle.land, lambda: vehicle.move_arm([0.0, 0.0])):
        try:
            attempt()
        except (RefusedError, InvalidValueError) as error:
            print(error)

# %% [markdown]
# ## 手写的抓取
#
# `state.obs` 里有机器人给出的全部信息，也包括任务的字段：`pick_place` 的方块和碗。给出工具位姿，机身与机械臂便一起运动。

# %%
def pick(vehicle):
    cube, bowl = (vehicle.state.obs[name] for name in ("cube_pos", "bowl_pos"))
    vehicle.tool_to(cube + [0.0, 0.0, 0.15])
    vehicle.tool_to(cube, within_m=0.01)
    vehicle.grip(0.0)
    vehicle.tool_to(cube + [0.0, 0.0, 0.25])
    vehicle.tool_to(bowl + [0.0, 0.0, 0.25], within_m=0.03)
    vehicle.tool_to(bowl + [0.0, 0.0, 0.12], within_m=0.03)
    vehicle.grip(1.0)
    vehicle.tool_to(bowl + [0.0, 0.0, 0.3], within_m=0.05)


with aerial_il.vehicle(robot="ua_quad_arm4", task="pick_place") as vehicle:
    won = []
    for seed in range(10):
        vehicle.reset(seed)
        vehicle.arm()
        vehicle.take_off(0.1)
        try:
            pick(vehicle)
            vehicle.land()
        except LinkError as error:
            print(f"seed {seed}: {error}")
        won.append(bool(vehicle.link.read().told["success"]))
print(f"in the bowl: {sum(won)} of {len(won)}")

# %% [markdown]
# ## 链路中断时
#
# 程序停了，机器人不能跟着出事：0.2 秒（按它自己的时钟）没有设定点，它就原地悬停。下面在飞行途中停发设定点。

# %%
with aerial_il.vehicle(robot="ua_quad_arm4") as vehicle:
    vehicle.arm()
    vehicle.take_off(0.3)
    link, path = vehicle.link, []
    for tick in range(150):
        if tick < 60:
            link.send("velocity", np.array([0.6, 0.0, 0.0, 0.0, *np.zeros(4), 1.0]))
        link.step()
        reading = link.read()
        path.append((0.02 * tick, reading.obs["base_vel"][0], reading.mode.value == "holding"))
    time, speed, holding = map(np.array, zip(*path))

fig, axis = plt.subplots(figsize=(7, 2.6))
axis.plot(time, speed)
axis.axvline(1.2, color="0.6", ls="--")
axis.fill_between(time, *axis.get_ylim(), where=holding & (time > 0.5), alpha=0.15)
axis.set(xlabel="time, s", ylabel="velocity, m/s", title="The last set point at 1.2 s; shaded: it hovers")
plt.show()
first = time[(time >= 1.2) & holding][0]
print(f"It hovers {1000 * (first - 1.2):.0f} ms after the last set point.")

# %% [markdown]
# ## 在 ROS 2 和 MAVLink 上也一样
#
# ```
# aerial-il simulate link=ros2 robot=ua_quad_arm4 task=pick_place      # 一个终端
# vehicle = aerial_il.vehicle("ros2")                                  # 一个脚本
# ```
#
# 策略也可以代替脚本来飞：`aerial-il fly policy=runs/pick link=ros2 out=datasets/flown`。以上都还没有在实机上飞过。
