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
# # 12. Flying a robot from a script
#
# Connect, arm, take off, go somewhere, move the arm, land: a few lines of Python, the same over every link. Here the robot is simulated
# in this process; over ROS 2 or MAVLink one word changes ([docs/robot_links.md](../docs/robot_links.md)). Then a policy's place is taken
# by a short script that picks up a cube, and in the end the link is lost, to see what the robot does by itself.

# %%
import matplotlib.pyplot as plt
import numpy as np

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.link import LinkError, RefusedError

# %% [markdown]
# ## Ten lines
#
# The robot stands in a cradle: an arm leaves no room for landing gear. Every call sends set points, fifty a second, until it is done;
# between two calls the robot hears none and hovers by itself. Positions are in metres in the world's frame, z up, angles in radians.

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
# What a robot cannot do it refuses, and says why; nothing changes by that.

# %%
with aerial_il.vehicle(robot="ua_quad_arm4") as vehicle:
    for attempt in (vehicle.take_off, vehicle.land, lambda: vehicle.move_arm([0.0, 0.0])):
        try:
            attempt()
        except (RefusedError, InvalidValueError) as error:
            print(error)

# %% [markdown]
# ## A pick by hand
#
# `state.obs` has all that the robot shows, the task's fields too: the cube and the bowl of `pick_place`. Tool poses fly base and arm
# together.

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
# ## When the link is lost
#
# A program that stops must not take the robot with it: without a set point for 0.2 s it hovers where it is, by its own clock. Below, the
# set points stop in full flight.

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
# ## The same over ROS 2 and MAVLink
#
# ```
# aerial-il simulate link=ros2 robot=ua_quad_arm4 task=pick_place      # a terminal
# vehicle = aerial_il.vehicle("ros2")                                  # a script
# ```
#
# Policies fly in the place of the script: `aerial-il fly policy=runs/pick link=ros2 out=datasets/flown`. Nothing of this has flown on
# hardware yet.
