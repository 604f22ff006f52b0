"""Policies that see the task from the tool, and nothing of how the robot itself stands."""

from dataclasses import replace

from aerial_il.policies.parts.network import PolicySettings

OWN_POSE = ("base_pos", "base_rot6d", "joint_*", "ee_*")
DECISIONS = ("gripper", "wrist_force")  # what policies that clone do not see by default


def egocentric[C: PolicySettings](config: C) -> C:
    """Return ``config`` with everything seen, and poses predicted, in the tool's own frame, but not the robot's pose.

    Demonstrations from few places show the robot's attitude, joints and place beside what they are there for. A network
    that sees them takes them for signs of how far the task is done.
    """
    more = (name for name in OWN_POSE if name not in config.masked_fields)
    return replace(config, relative=True, masked_fields=(*config.masked_fields, *more))


def chose_view(config: PolicySettings) -> bool:
    """Whether ``config`` says itself in which frame, or what of the robot, the policy sees."""
    return bool(config.obs_names) or config.relative or config.masked_fields != DECISIONS
