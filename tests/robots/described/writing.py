"""URDF, MJCF and STL for tests, all of our own making."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from aerial_il.robots.parts.arm import Link

INERTIA = ("ixx", "iyy", "izz")


def inertial(mass: float, com: Sequence[float], moments: Sequence[float]) -> str:
    """An ``<inertial>`` with its axes along those of the link."""
    written = " ".join(f'{name}="{float(value)!r}"' for name, value in zip(INERTIA, moments, strict=True))
    x, y, z = (repr(float(value)) for value in com)
    return (
        f'<inertial><origin xyz="{x} {y} {z}"/><mass value="{float(mass)!r}"/>'
        f'<inertia {written} ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def urdf_of(links: Sequence[Link], *, foot_m: float, foot_kg: float) -> str:
    """An arm of our own as URDF: a foot, links ``link_j`` moved by joints ``joint_j``, a frame ``tool`` at the end."""
    parts = ['<robot name="written">', f'<link name="foot">{inertial(foot_kg, (0, 0, 0), (1e-3,) * 3)}</link>']
    parent, seat = "foot", (0.0, 0.0, foot_m)
    for j, link in enumerate(links):
        x, y, z = (repr(float(value)) for value in seat)
        low, high = link.limits
        parts += [
            f'<link name="link_{j}">{inertial(link.mass, link.com, link.inertia)}</link>',
            f'<joint name="joint_{j}" type="revolute"><parent link="{parent}"/><child link="link_{j}"/>',
            f'<origin xyz="{x} {y} {z}"/><axis xyz="{" ".join(map(str, link.axis))}"/>',
            f'<limit lower="{low}" upper="{high}" effort="{link.torque}" velocity="{link.speed}"/></joint>',
        ]
        parent, seat = f"link_{j}", link.tip
    x, y, z = (repr(float(value)) for value in seat)
    parts += [
        '<link name="tool"/>',
        f'<joint name="flange" type="fixed"><parent link="{parent}"/><child link="tool"/><origin xyz="{x} {y} {z}"/>',
        "</joint></robot>",
    ]
    return "\n".join(parts)


BOX = '<collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision>'
PITCH = """<robot name="small">
<link name="plate"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="0.2"/>
<inertia ixx="1e-4" iyy="7e-4" izz="7e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.02 0.02"/></geometry></collision></link>
<link name="lower"><inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>
<inertia ixx="1e-5" iyy="9e-5" izz="9e-5" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.05 0 0"/><geometry><box size="0.1 0.02 0.02"/></geometry></collision></link>
<link name="flange"/>
<joint name="shoulder" type="revolute"><parent link="plate"/><child link="upper"/><origin xyz="0 0 0.01"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="5" velocity="4"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.2 0 0"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="3" velocity="4"/></joint>
<joint name="end" type="fixed"><parent link="lower"/><child link="flange"/><origin xyz="0.1 0 0"/></joint>
</robot>
"""

PITCH_MJCF = """<mujoco model="small"><compiler angle="radian" autolimits="true"/>
<worldbody><body name="plate">
<body name="upper" pos="0 0 0.01"><joint name="shoulder" axis="0 1 0" range="-1 2" armature="0.004"/>
<inertial pos="0.1 0 0" mass="0.2" diaginertia="1e-4 7e-4 7e-4"/>
<geom name="upper" type="box" size="0.1 0.01 0.01" pos="0.1 0 0"/>
<body name="lower" pos="0.2 0 0"><joint name="elbow" axis="0 1 0" range="-2 2" actuatorfrcrange="-3 3"/>
<inertial pos="0.05 0 0" mass="0.1" diaginertia="1e-5 9e-5 9e-5"/>
<geom name="lower" type="box" size="0.05 0.01 0.01" pos="0.05 0 0"/>
<body name="flange" pos="0.1 0 0"/>
</body></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="40" kv="2" forcerange="-5 5"/>
<motor name="elbow" joint="elbow" ctrlrange="-4 4"/></actuator>
</mujoco>
"""

QUAD_MJCF = """<mujoco model="tern"><compiler autolimits="true"/>
<worldbody><body name="tern"><freejoint/>
<inertial pos="0.02 0 0.01" mass="1.5" diaginertia="0.015 0.016 0.028"/>
<geom name="body" type="box" size="0.08 0.05 0.03"/>
<site name="fl" pos="0.17 0.15 0.04"/><site name="fr" pos="0.17 -0.15 0.04"/>
<site name="rl" pos="-0.13 0.15 0.04"/><site name="rr" pos="-0.13 -0.15 0.04"/>
</body></worldbody>
<actuator>
<general name="fl" site="fl" gear="0 0 1 0 0 0.016" ctrlrange="0 13"/>
<general name="fr" site="fr" gear="0 0 1 0 0 -0.016" ctrlrange="0 13"/>
<general name="rl" site="rl" gear="0 0 1 0 0 -0.016" ctrlrange="0 13"/>
<general name="rr" site="rr" gear="0 0 2 0 0 0.032" ctrlrange="0 6.5"/>
</actuator></mujoco>
"""


def stl(vertices: np.ndarray, faces: Sequence[tuple[int, int, int]]) -> bytes:
    """A binary STL."""
    result = bytes(80) + struct.pack("<I", len(faces))
    for face in faces:
        corners = np.asarray(vertices, np.float32)[list(face)]
        result += struct.pack("<12fH", 0.0, 0.0, 0.0, *corners.ravel(), 0)
    return result


def cube(half: float) -> bytes:
    """A cube as STL; ``half`` size in m."""
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return stl(corners, [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
