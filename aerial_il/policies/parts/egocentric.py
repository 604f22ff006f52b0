"""Policies that see the task from the tool, and nothing of how the robot itself stands."""

from __future__ import annotations

from dataclasses import fields, replace

from aerial_il.policies.parts.network import PolicySettings

OWN_POSE = ("base_pos", "base_rot6d", "joint_*", "ee_*")
VIEW = ("relative", "blind_to")  # settings that decide it


def egocentric[C: PolicySettings](config: C) -> C:
    """Return ``config`` with everything seen, and poses predicted, in the tool's own frame, blind to the robot's pose.

    Demonstrations from few places show the robot's attitude, joints and place beside what they are there for. A network
    that sees them takes them for signs of how far the task is done.
    """
    more = (name for name in OWN_POSE if name not in config.blind_to)
    return replace(config, relative=True, blind_to=(*config.blind_to, *more))


def chose_view(config: PolicySettings) -> bool:
    """Whether ``config`` says itself in which frame, or what of the robot, the policy sees."""
    usual = {field.name: field.default for field in fields(PolicySettings)}
    return bool(config.obs_names) or any(getattr(config, name) != usual[name] for name in VIEW)
