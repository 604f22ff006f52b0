"""Views of a step for people: standard ROS 2 messages, which repeat what is recorded exactly elsewhere."""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from aerial_il.core.specs import EnvSpec, Field
from aerial_il.data.recording.encoding import messages
from aerial_il.data.recording.encoding.poses import quat_xyzw
from aerial_il.data.recording.encoding.topics import ALL, Camera, Extras, FixedTopic, Sources


class Views:
    """The topics by which one environment is looked at.

    Args:
        spec: the environment's specification.
        extras: name -> labels of further numbers of each step.
    """

    def __init__(self, spec: EnvSpec, extras: Extras) -> None:
        self.spec, self.extras = spec, extras
        self.bodies = tuple(f.name.removesuffix("_pos") for f in spec.observation.fields if _is_position(f))

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Where each state field lies in the flat observation."""
        fields = [self.spec.observation[name] for name in self.spec.observation.state_names]
        ends = np.cumsum([field.size for field in fields]).tolist()
        return {f.name: slice(end - f.size, end) for f, end in zip(fields, ends, strict=True)}

    def observed(self, channels: Iterator[int]) -> list[FixedTopic]:
        """Return the topics that show an observation."""
        return [self._observation(next(channels)), *self._joints(channels), *self._poses(channels)]

    def acted(self, channels: Iterator[int]) -> list[FixedTopic]:
        """Return the topics that show an action and its reward."""
        action, reward = messages.joint_state(self.spec.action.labels), messages.float_array(1)
        return [
            FixedTopic(next(channels), "/action", messages.JOINT_STATE, action, {"position": ("action", ALL)}),
            FixedTopic(next(channels), "/reward", messages.FLOAT_ARRAY, reward, {"data": ("reward", ALL)}),
        ]

    def further(self, channels: Iterator[int]) -> list[FixedTopic]:
        """Return the topics of further numbers."""
        return [
            FixedTopic(next(channels), f"/{name}", messages.JOINT_STATE, messages.joint_state(labels), _whole(name))
            for name, labels in self.extras.items()
        ]

    def cameras(self, channels: Iterator[int]) -> list[Camera]:
        """Return the topics of images."""
        return [
            Camera(next(channels), f.name, f.shape, f.dtype, f.every > 1)
            for f in self.spec.observation.of_group("image")
        ]

    def quats(self, flat: np.ndarray) -> dict[str, np.ndarray]:
        """Return the unit quaternion ``quat_<body>`` (k, 4), x y z w, of every body, from flat observations (k, Do)."""
        quats = {f"quat_{body}": np.array([[0.0, 0.0, 0.0, 1.0]]).repeat(len(flat), 0) for body in self.bodies}
        turning = [body for body in self.bodies if f"{body}_rot6d" in self.slices]
        if turning:
            rot6d = np.concatenate([flat[:, self.slices[f"{body}_rot6d"]] for body in turning])
            parts = quat_xyzw(rot6d).reshape(len(turning), len(flat), 4)
            quats.update((f"quat_{body}", part) for body, part in zip(turning, parts, strict=True))
        return quats

    def _observation(self, channel: int) -> FixedTopic:
        names = self.spec.observation.state_names
        labels = tuple(label for name in names for label in self.spec.observation[name].element_labels())
        template = messages.joint_state(labels)
        return FixedTopic(channel, "/observation", messages.JOINT_STATE, template, {"position": ("observation", ALL)})

    def _joints(self, channels: Iterator[int]) -> Iterator[FixedTopic]:
        if "joint_pos" not in self.spec.observation.names:
            return
        labels = self.spec.observation["joint_pos"].element_labels()
        sources = {"position": ("observation", self.slices["joint_pos"])}
        if moving := "joint_vel" in self.slices:
            sources["velocity"] = ("observation", self.slices["joint_vel"])
        template = messages.joint_state(labels, velocity=moving)
        yield FixedTopic(next(channels), "/joint_states", messages.JOINT_STATE, template, sources)

    def _poses(self, channels: Iterator[int]) -> Iterator[FixedTopic]:
        places = {body: ("observation", self.slices[f"{body}_pos"]) for body in self.bodies}
        turns = {body: (f"quat_{body}", ALL) for body in self.bodies}
        for body in self.bodies:
            sources = {"position": places[body], "orientation": turns[body]}
            pose = messages.pose_stamped("world")
            yield FixedTopic(next(channels), f"/pose/{body}", messages.POSE_STAMPED, pose, sources)
        if self.bodies:
            frames = {f"translation{i}": places[body] for i, body in enumerate(self.bodies)}
            frames |= {f"rotation{i}": turns[body] for i, body in enumerate(self.bodies)}
            tree = messages.transforms("world", self.bodies)
            yield FixedTopic(next(channels), "/tf", messages.TF_MESSAGE, tree, frames)


def _whole(name: str) -> Sources:
    return {"position": (name, ALL)}


def _is_position(field: Field) -> bool:
    return field.name.endswith("_pos") and field.shape == (3,) and field.unit == "m"
