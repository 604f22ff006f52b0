"""A policy that was exported: an ONNX graph and a description, flown without torch and without MuJoCo.

``network.onnx`` maps normalised histories to normalised chunks; ``exported.json`` has all that is needed around it:
fields with their units, anchor, normalisation, how chunks are flown. Nothing is unpickled, and no code is run.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerial_il.core.bounded import read_bytes, read_json
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.policies.parts.flying import FlyingPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches

if TYPE_CHECKING:
    from onnxruntime import InferenceSession  # pyright: ignore[reportMissingImports]

    from aerial_il.policies.parts.chunk_policy import ChunkPolicy

SCHEMA = "aerial_il.exported_policy/1"
GRAPH, DESCRIPTION, CARD = "network.onnx", "exported.json", "README.md"
STATE, IMAGE, NOISE, ACTIONS = "state", "image.", "noise", "actions"
LARGEST_GRAPH = 2 << 30  # bytes; protobuf allows no more
MOST = 1 << 24  # numbers that one world shows at once, draws or is answered


@dataclass(frozen=True, kw_only=True)
class Flown:
    """How chunks are flown.

    Attributes:
        name: of the policy's class. history: observations that it sees. chunk: actions that it answers.
        execute: steps between two answers. ensemble: decay of the weights of overlapping chunks, or None.
    """

    name: str
    history: int
    chunk: int
    execute: int
    ensemble: float | None

    def __post_init__(self) -> None:
        for name in ("history", "chunk", "execute"):
            _count(name, getattr(self, name))
        if self.ensemble is not None and not math.isfinite(self.ensemble):
            raise ValueError(f"its ensemble is {self.ensemble}")


class OnnxPolicy(FlyingPolicy):
    """An exported policy; acts as the one that it was exported from.

    Args:
        config: how its chunks are flown. interface: what the graph is wired to. session: of onnxruntime.
        noise_size, redraws: numbers that one answer takes, and whether each takes new ones.
        origin: where the policy comes from. sha256: of all that decides how it flies.
    """

    config: Flown

    def __init__(
        self,
        config: Flown,
        interface: Interface,
        session: InferenceSession,
        *,
        noise_size: int,
        redraws: bool,
        origin: Mapping[str, Any],
        sha256: str,
    ) -> None:
        super().__init__(config, interface, noise_size=noise_size, redraws=redraws, origin=origin)
        self.sha256 = sha256
        self._session, self._inputs = session, tuple(each.name for each in session.get_inputs())

    def answer(
        self, state: np.ndarray, images: Mapping[str, np.ndarray], noise: np.ndarray | None, guide: Any = None
    ) -> np.ndarray:
        if noise is None and self._noise.size:
            noise = np.zeros((len(state), self._noise.size), np.float32)
        given = {STATE: state, NOISE: noise, **{IMAGE + name: image for name, image in images.items()}}
        return self._session.run([ACTIONS], {name: np.ascontiguousarray(given[name]) for name in self._inputs})[0]

    def fresh(self) -> OnnxPolicy:
        again = OnnxPolicy(
            self.config, self.interface, self._session,
            noise_size=self._noise.size, redraws=self._noise.redraw, origin=self.origin,
            sha256=self.sha256,
        )  # fmt: skip
        return again._as(self)


def described(policy: ChunkPolicy, graph: bytes) -> dict[str, Any]:
    """Return the contents of ``exported.json``, plain values: all but the graph."""
    wiring, config = policy.interface, policy.config
    layout = wiring.layout
    said = {
        "schema": SCHEMA,
        "flown": {name: getattr(config, name) for name in Flown.__annotations__},
        "noise": {"size": policy.network.noise_size, "redraws": policy.network.redraws},
        "layout": {name: value for name, value in _fields(layout).items() if name != "spec"},
        "obs": _plain(wiring.obs),
        "action": _plain(wiring.action),
        "obs_clip": wiring.obs_clip,
        "switches": {n: [None if np.isnan(v) else v for v in a.tolist()] for n, a in wiring.switches.arrays().items()},
        "origin": policy.origin,
        "spec": layout.spec.to_dict(),
    }
    return {**said, "sha256": _digest(json.loads(json.dumps(said)), graph)}


def load_exported(folder: Path, *, threads: int = 1) -> OnnxPolicy:
    """Load an exported policy.

    Args:
        folder: with ``network.onnx`` and ``exported.json``. threads: of onnxruntime.

    Raises:
        CheckpointError: it is incomplete, altered, or of a later release. InvalidValueError: onnxruntime is missing.
    """
    try:
        from onnxruntime import InferenceSession, SessionOptions  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise InvalidValueError(f"{folder} is an exported policy: pip install onnxruntime") from error
    try:
        said = read_json(folder / DESCRIPTION)
        graph = read_bytes(folder / GRAPH, most=LARGEST_GRAPH)
        if said.get("schema") != SCHEMA:
            raise ValueError(f"its schema is {said.get('schema')}, not {SCHEMA}")
        if (sha256 := said.pop("sha256")) != _digest(said, graph):
            raise ValueError(f"{GRAPH} or {DESCRIPTION} was altered: they are not those of its digest")
        options = SessionOptions()
        options.intra_op_num_threads = threads
        session = InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        size = _count("noise", said["noise"]["size"], least=0)
        policy = OnnxPolicy(
            Flown(**said["flown"]), _interface(said), session,
            noise_size=size, redraws=bool(said["noise"]["redraws"]), origin=said["origin"], sha256=sha256,
        )  # fmt: skip
        _require_fitting(policy, size)
        return policy
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError, InvalidValueError) as error:
        raise CheckpointError(folder, f"is no policy that was exported by this release ({error}).") from error


def _digest(said: Mapping[str, Any], graph: bytes) -> str:
    """Return the SHA-256 of a graph and of all else that is said of it."""
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode() + graph).hexdigest()


def _count(name: str, value: object, *, least: int = 1) -> int:
    if type(value) is not int or not least <= value <= MOST:
        raise ValueError(f"its {name} is {value!r}, no number from {least} to {MOST}")
    return value


def _require_fitting(policy: OnnxPolicy, noise_size: int) -> None:
    """Refuse a graph that does not answer one world as the description says: whoever flies it relies on that."""
    wiring, frames = policy.interface, (1, policy.config.history)
    layout, size = wiring.layout, wiring.layout.spec.action.size
    wired = tuple(len(each) for each in (wiring.obs.scale, wiring.action.scale, *wiring.switches.arrays().values()))
    if wired != (layout.size, size, size, size):
        raise ValueError(f"it normalises {wired} elements of {(layout.size, size, size, size)}")
    shapes = {name: (*frames, *shape) for name, shape in zip(layout.images, layout.image_shapes, strict=True)}
    for name, shape in {STATE: (*frames, layout.size), **shapes}.items():
        _count(name, math.prod(shape), least=0)
    state, noise = np.zeros((*frames, layout.size), np.float32), np.zeros((1, noise_size), np.float32)
    images = {n: np.zeros(shapes[n], dtype) for n, dtype in zip(layout.images, layout.image_dtypes, strict=True)}
    answered, wanted = policy.answer(state, images, noise).shape, (1, policy.config.chunk, size)
    if answered != wanted:
        raise ValueError(f"{GRAPH} answers {answered}, not {wanted}")


def _fields(layout: Layout) -> dict[str, Any]:
    return {name: getattr(layout, name) for name in Layout.__annotations__}


def _plain(normaliser: Normaliser) -> dict[str, Any]:
    arrays = {name: value for name, value in asdict(normaliser).items() if value is not None}
    return {name: array.tolist() for name, array in arrays.items()}


def _interface(said: Mapping[str, Any]) -> Interface:
    shown: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in said["layout"].items()}
    layout = Layout(EnvSpec.from_dict(said["spec"]), **shown)
    obs, action = (_normaliser(said[name]) for name in ("obs", "action"))
    switches = {name: np.array(values, np.float32) for name, values in said["switches"].items()}
    return Interface(layout, obs, action, float(said["obs_clip"]), Switches.from_arrays(switches))


def _normaliser(said: Mapping[str, Any]) -> Normaliser:
    constant = np.array(said["constant"], bool) if "constant" in said else None
    return Normaliser(np.array(said["centre"], np.float32), np.array(said["scale"], np.float32), constant)
