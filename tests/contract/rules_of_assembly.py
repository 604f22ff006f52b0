"""What the instruction about the frame asks for, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from tests.contract.placed import ALL, ANY, NONE, SOME, Placed, Scatter, Stage, about, anywhere, ball, with_robot
from tests.contract.rules_of_long_tasks import quats, raised

# assemble_frame: "Take the orange beam off its supports and lay it into both blue hooks."

HOOKS_M, LYING_M = (-0.13, 0.13), 0.07  # along the frame; height of a beam's middle that lies in them
DOWN, ACROSS, ALONG = np.eye(3)[[2, 1, 0]]
Span = tuple[float, float]


def beam_in_hooks(placed: Placed) -> np.ndarray:
    """Its axis goes through the middle of both hooks, stripe up, both ends out; at rest and let go."""
    axes = placed.mat("frame")
    middle = np.einsum("nji,nj->ni", axes, placed.pos("beam") - placed.pos("frame")) - [0.0, 0.0, LYING_M]
    beam = np.einsum("nji,njk->nik", axes, placed.mat("beam"))
    slope = beam[:, 1:, 0] / np.where(np.abs(beam[:, :1, 0]) < 0.5, np.nan, beam[:, :1, 0])
    through = [middle[:, 1:] + (hook - middle[:, :1]) * slope for hook in HOOKS_M]
    inside = np.all([np.abs(point) <= 0.002 for point in through], axis=(0, 2))
    ends = np.abs(middle[:, 0]) <= 0.03
    stripe_up = placed.mat("beam")[:, 2, 2] >= np.cos(np.deg2rad(10.0))
    still = np.linalg.norm(placed.vel("beam"), axis=1) <= 0.05
    backed_off = np.linalg.norm(placed.pos("beam") - placed.tool, axis=1) >= 0.08
    return inside & ends & stripe_up & still & backed_off & ~placed.robot_on("beam") & placed.untouched


def beam_at(
    *,
    along: Span = (-0.029, 0.029),
    beside: Span = (-0.001, 0.001),
    over: Span = (-0.001, 0.001),
    yaw_deg: Span = (-0.3, 0.3),
    pitch_deg: Span = (-0.3, 0.3),
    roll_deg: Span = (-9.0, 9.0),
    speed: Span = (0.0, 0.0),
) -> Scatter:
    """Put the beam so far from where it lies in the frame, either end first."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        home, axes = stage.where(rows, "frame")
        offset = np.stack([rng.uniform(*span, rows.size) for span in (along, beside, over)], axis=1)
        offset[:, 2] += LYING_M
        mats = []
        for mat in axes:
            yaw, pitch, roll = (np.deg2rad(rng.uniform(*span)) for span in (yaw_deg, pitch_deg, roll_deg))
            end = np.pi * rng.integers(2)
            mats.append(mat @ about(DOWN, yaw + end) @ about(ACROSS, pitch) @ about(ALONG, roll))
        raised(stage, rows, rng)
        vel = ball(rng, rows.size, *speed)
        stage.free(rows, "beam", home + np.einsum("kij,kj->ki", axes, offset), quats(np.array(mats)), vel)

    return place


FRAME = {
    "in both hooks, either end first": (ALL, beam_at()),
    "anywhere": (NONE, anywhere("beam")),
    "on its supports": (NONE, raised),
    "beside the hooks": (NONE, beam_at(beside=(0.0021, 0.3), yaw_deg=(-0.01, 0.01))),
    "on the edges of their walls": (NONE, beam_at(over=(0.0025, 0.05))),
    "through their floors": (NONE, beam_at(over=(-0.4, -0.0025))),
    "in one hook": (NONE, beam_at(pitch_deg=(1.5, 20.0))),
    "turned out of one hook": (NONE, beam_at(yaw_deg=(1.5, 30.0))),
    "hardly turned": (SOME, beam_at(yaw_deg=(-1.2, 1.2), beside=(-1e-4, 1e-4))),
    "one end short": (NONE, beam_at(along=(0.0301, 0.3))),
    "across the frame": (NONE, beam_at(yaw_deg=(60.0, 120.0))),
    "upside down, on its side": (NONE, beam_at(roll_deg=(80.0, 280.0))),
    "leaning": (SOME, beam_at(roll_deg=(6.0, 14.0))),
    "moving": (NONE, beam_at(speed=(0.0501, 1.0))),
    "hardly moving": (SOME, beam_at(speed=(0.04, 0.06))),
    "in the gripper": (NONE, with_robot(beam_at(), "tool", "beam", 0.0, 0.07)),
    "gripper near": (ANY, with_robot(beam_at(), "tool", "beam", 0.07, 0.12)),
    "held down by a link": (NONE, with_robot(beam_at(), "link_1", "beam", 0.0, 0.01)),
}
