"""The mapping from observations to a network's input and from its output to actions: fields, anchor, normalisers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError, UnknownNameError
from aerial_il.core.specs import EnvSpec, Field, camera_text
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.relative import POSE, into_tool, into_world, rotations, turned
from aerial_il.policies.parts.switches import Switches

if TYPE_CHECKING:
    from aerial_il.policies.parts.network import PolicySettings

TOOL = ("ee_pos", "ee_rot6d")  # what the end effector's pose is observed as
TO_BE_SEEN = "to_be_seen"  # among masked fields: all that a robot does not know by itself


@dataclass(frozen=True)
class Layout:
    """The columns of a network's input, a frame (Do,), and which of them are positions relative to the anchor.

    Nearly all that a manipulator does depends on where things are relative to its end effector. A network that sees
    so needs not learn it from the few places that the demonstrations visited.

    Attributes:
        spec: the environment that the demonstrations came from.
        names: observation fields, in the order of the columns.
        anchor: the position field that other positions are relative to, or None.
        images: colour and depth images that the network sees beside the columns.
        relative: whether vectors are seen, and actions are poses, in the end effector's own frame.
        unseen: fields that others are counted from, which the network itself sees as zeros: not seeing where it is, it
            does alike everywhere.
    """

    spec: EnvSpec
    names: tuple[str, ...]
    anchor: str | None = None
    images: tuple[str, ...] = ()
    relative: bool = False
    unseen: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.names:
            if self.spec.observation[name].group == "image":
                choices = ", ".join(self.spec.observation.state_names)
                hint = f"Name it in policy.images=[...]; among the columns it can see {choices}."
                raise InvalidValueError(f"Observation {name!r} is an image. {hint}")
        recorded = tuple(f.name for f in self.spec.observation.fields if f.is_colour or f.is_depth)
        for name in self.images:
            if name not in recorded:
                hint = "Record it: aerial-il collect cameras=[wrist,base] image_size=[64,64]"
                raise UnknownNameError("colour or depth image", name, recorded, hint)
        if not {*self.names} - {*self.unseen} and not self.images:
            raise InvalidValueError(
                "The policy sees neither a state field nor an image. Name some in policy.images=[...]."
            )
        if self.anchor is not None and self.anchor not in self._positions:
            raise UnknownNameError("anchor", self.anchor, self._positions, "Or set policy.anchor=null.")
        if self.relative:
            self._check_relative()

    @staticmethod
    def of(spec: EnvSpec, config: PolicySettings) -> Layout:
        """Return the layout that a policy of this configuration sees ``spec`` in.

        An environment from outside the suite that shows no positions has nothing to anchor.
        """
        hidden = {name for name in spec.observation.state_names if any(fnmatch(name, p) for p in config.masked_fields)}
        if TO_BE_SEEN in config.masked_fields:
            hidden |= _to_be_seen(spec, config)
        counted_from = {config.anchor, *(TOOL if config.relative else ())}
        unseen = (
            () if config.obs_names else tuple(n for n in spec.observation.state_names if n in hidden & counted_from)
        )
        names = config.obs_names or tuple(n for n in spec.observation.state_names if n not in hidden or n in unseen)
        placed = any(_is_position(spec.observation[name]) for name in names if name not in unseen)
        anchor = config.anchor if placed or not spec.is_outside else None
        return Layout(spec, names, anchor, config.images, config.relative, unseen)

    @property
    def size(self) -> int:
        """Columns Do."""
        return self.spec.observation.size(self.names)

    @property
    def image_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes (H, W, 3), or (H, W) of depth, of the images, in their order."""
        return tuple(self.spec.observation[name].shape for name in self.images)

    @property
    def image_dtypes(self) -> tuple[str, ...]:
        """``uint8`` of colour, ``float32`` of depth, m, in their order."""
        return tuple(self.spec.observation[name].dtype for name in self.images)

    @property
    def anchored(self) -> int:
        """How many elements at the front of an action are relative to the anchor: the position of an ``ee_pose``."""
        return 3 if self.anchor and not self.relative and self.spec.action.level == "ee_pose" else 0

    @property
    def moving(self) -> np.ndarray:
        """(Da,) bool, action elements that are counted from the end effector, or from the anchor, as it moves."""
        return np.arange(self.spec.action.size) < (POSE if self.relative else self.anchored)

    def flatten(self, obs: Observation) -> np.ndarray:
        """Return frames (n, Do), every position still in the world, for observations ``name -> (n, ...)``.

        Raises:
            UnknownNameError: a field is missing.
            NonFiniteActionError: a field is not finite.
        """
        for name in self.names:
            if name not in obs:
                raise UnknownNameError("observation", name, obs, "The policy was trained with this field.")
        if not self.names:
            return np.zeros((len(obs[self.images[0]]), 0))
        frames = self.spec.observation.flatten(obs, self.names)
        if not np.isfinite(frames).all():
            raise NonFiniteActionError(*_first_bad(obs, self.names))
        return frames

    def look(self, obs: Observation) -> dict[str, np.ndarray]:
        """Return the images (n, H, W, 3) uint8, or (n, H, W) float32 m, that the network sees, by name.

        Args:
            obs: observations ``name -> (n, ...)``.

        Raises:
            UnknownNameError: one is missing. InvalidValueError: one has another size.
        """
        for name, shape in zip(self.images, self.image_shapes, strict=True):
            if name not in obs:
                there = [key for key, values in obs.items() if values.dtype == np.uint8]
                raise UnknownNameError("image", name, there, f"The policy was trained with {self.cameras}.")
            if obs[name].shape[1:] != shape:
                found = _size(obs[name].shape[1:])
                raise InvalidValueError(f"Image {name!r} is {found}; the policy was trained with {self.cameras}.")
        return {name: obs[name] for name in self.images}

    @property
    def cameras(self) -> str:
        """The images, their sizes and when they are taken, in words."""
        return _in_words(self.spec.observation[name] for name in self.images)

    def relate(self, frames: np.ndarray) -> np.ndarray:
        """Return frames (..., Do) as the network sees them.

        Every position but the anchor's own is relative to it; with ``relative``, vectors and orientations lie in the
        axes of the end effector.
        """
        frames = frames.copy()
        for columns in self._relative:
            frames[..., columns] -= frames[..., self._anchor]
        if self._vectors:
            rot_tool_from_world = np.swapaxes(rotations(frames[..., self._columns("ee_rot6d")]), -1, -2)
            for columns in self._vectors:
                frames[..., columns] = turned(rot_tool_from_world, frames[..., columns])
        for name in self.unseen:
            frames[..., self._columns(name)] = 0.0
        return frames

    def offset_of(self, frames: np.ndarray) -> np.ndarray:
        """Return what turns the anchored elements of an action into world positions (..., anchored)."""
        return frames[..., self._anchor][..., : self.anchored]

    def tool_of(self, frames: np.ndarray) -> np.ndarray:
        """Return the end effector's pose in the world (..., 9), position and rot6d."""
        return np.concatenate([frames[..., self._columns(name)] for name in TOOL], axis=-1)

    def origin_of(self, frames: np.ndarray) -> np.ndarray:
        """Return what the moving elements of an action are counted from (..., k)."""
        return self.tool_of(frames) if self.relative else self.offset_of(frames)

    def counted(self, moving: np.ndarray, origin: np.ndarray) -> np.ndarray:
        """Return the moving elements of actions (..., k), which come first, counted from :meth:`origin_of`."""
        return into_tool(moving, origin) if self.relative else moving - origin

    def _check_relative(self) -> None:
        if self.spec.action.level != "ee_pose":
            raise InvalidValueError(
                f"policy.relative=true needs ee_pose actions; these are {self.spec.action.level}. "
                "Set policy.relative=false."
            )
        for name in TOOL:
            if name not in self.names:
                raise UnknownNameError(
                    "observation", name, self.names, "policy.relative=true needs it; see policy.obs_names."
                )

    @cached_property
    def _positions(self) -> tuple[str, ...]:
        return tuple(name for name in self.names if _is_position(self.spec.observation[name]))

    @cached_property
    def _anchor(self) -> slice:
        return self._columns(self.anchor) if self.anchor else slice(0, 0)

    @cached_property
    def _moved(self) -> tuple[str, ...]:
        """The positions that are seen relative to the anchor."""
        return tuple(name for name in self._positions if self.anchor and name != self.anchor)

    @cached_property
    def _relative(self) -> tuple[slice, ...]:
        return tuple(self._columns(name) for name in self._moved)

    @cached_property
    def _vectors(self) -> tuple[slice, ...]:
        """What is turned into the axes of the tool: all vectors but its own pose and positions still in the world."""
        staying = ({*self._positions} - {*self._moved}) | {*TOOL}
        turning = [n for n in self.names if n not in staying and _has_axes(self.spec.observation[n])]
        return tuple(self._columns(name) for name in turning) if self.relative else ()

    def _columns(self, name: str) -> slice:
        start = self.spec.observation.size(self.names[: self.names.index(name)])
        return slice(start, start + self.spec.observation[name].size)


@dataclass(frozen=True)
class Interface:
    """A layout with the normalisers fitted to it: the way into a network and the way out.

    Attributes:
        layout: what goes in and comes out.
        obs: normaliser of related frames (Do,).
        action: normaliser of actions (Da,), anchored ones as offsets from the anchor, relative ones as such.
        obs_clip: limit of normalised observations; there is none where they are left as they are.
        switches: action elements with a few values only.
    """

    layout: Layout
    obs: Normaliser
    action: Normaliser
    obs_clip: float
    switches: Switches

    @property
    def constant(self) -> np.ndarray:
        """(Da,) bool, action elements that demonstrations never varied: they have no spread, and keep their units."""
        found = self.action.constant
        return np.zeros(len(self.action.scale), bool) if found is None else found

    @property
    def varied(self) -> np.ndarray:
        """(Da,) bool, action elements that were seen to vary; all of them where none was."""
        return self.constant if self.constant.all() else ~self.constant

    def encode_obs(self, history: np.ndarray) -> np.ndarray:
        """Return the network's input, float32, for frames (B, To, Do) in the world."""
        return self.normalise_obs(self.layout.relate(history))

    def normalise_obs(self, related: np.ndarray) -> np.ndarray:
        """Return related frames (..., Do) as the network sees them, float32."""
        normalised = self.obs.normalise(related)
        if self.obs.is_identity:
            return normalised
        return np.clip(normalised, -self.obs_clip, self.obs_clip, out=normalised)

    def encode_actions(self, actions: np.ndarray, history: np.ndarray) -> np.ndarray:
        """Return what the network should answer, float32, for actions (B, Ta, Da) demonstrated after ``history``."""
        return self.action.normalise(to_offsets(self.layout, actions, history))

    def decode_actions(self, outputs: np.ndarray, history: np.ndarray) -> np.ndarray:
        """Return actions (B, Ta, Da) in the environment's units for the network's answer to ``history``."""
        actions = self.action.denormalise(outputs)
        if self.layout.relative:
            actions[..., :POSE] = into_world(actions[..., :POSE], self.layout.tool_of(history[:, -1:]))
        actions[..., : self.layout.anchored] += self.layout.offset_of(history[:, -1:]).astype(np.float32)
        return actions


def to_offsets(layout: Layout, actions: np.ndarray, history: np.ndarray) -> np.ndarray:
    """Return actions (B, Ta, Da) with what is anchored or relative counted from the last frame of ``history``."""
    actions, moving = actions.copy(), slice(0, layout.moving.sum())
    actions[..., moving] = layout.counted(actions[..., moving], layout.origin_of(history[:, -1:]))
    return actions


def _to_be_seen(spec: EnvSpec, config: PolicySettings) -> set[str]:
    """Return what a robot does not know by itself, of which a configuration that hides it may show nothing."""
    hidden = {*spec.observation.to_be_seen}
    for key, names in (("obs_names", config.obs_names), ("anchor", (config.anchor,))):
        if shown := hidden.intersection(names):
            raise InvalidValueError(
                f"policy.{key} shows {min(shown)}, and observations=onboard hides it: a robot does not know it by "
                f"itself. It knows {', '.join(n for n in spec.observation.state_names if n not in hidden)}."
            )
    return hidden


def _is_position(field: Field) -> bool:
    return field.name.endswith("_pos") and field.shape == (3,) and field.unit == "m"


def _has_axes(field: Field) -> bool:
    """Whether a field holds vectors in the world: points, displacements, velocities, axes, or a rotation's columns."""
    named = field.name.endswith(("_rot6d", "_axis"))
    return field.shape in ((3,), (6,)) and (named or field.unit in ("m", "m/s"))


def check_cameras(layout: Layout, spec: EnvSpec) -> None:
    """Raise :class:`InvalidValueError`, naming both, unless ``spec`` shows the images of ``layout`` as it has them."""
    shown = spec.observation.of_group("image")
    wanted = [layout.spec.observation[name] for name in layout.images]
    if {_taken(field) for field in wanted} - {_taken(field) for field in shown}:
        asked = ",".join(camera_text(field, layout.spec.control_dt_s) for field in wanted)
        raise InvalidValueError(
            f"The policy sees {layout.cameras}; the environment shows {_in_words(shown)}. "
            f"Load it with cameras=[{asked}]."
        )


def _taken(field: Field) -> tuple[object, ...]:
    return field.name, field.shape, field.every, field.delay


def _in_words(images: Iterable[Field]) -> str:
    return ", ".join(f"{field.name} {_size(field.shape)}{_timing(field)}" for field in images) or "no images"


def _timing(field: Field) -> str:
    every = f" every {field.every} steps" if field.every > 1 else ""
    return f"{every} {field.delay} steps late" if field.delay else every


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(str(side) for side in shape[:2])


def _first_bad(obs: Observation, names: tuple[str, ...]) -> tuple[str, np.ndarray]:
    finite = {name: np.isfinite(obs[name]).reshape(len(obs[name]), -1).all(1) for name in names}
    name = next(name for name in names if not finite[name].all())
    return f"observation {name}", np.flatnonzero(~finite[name])
