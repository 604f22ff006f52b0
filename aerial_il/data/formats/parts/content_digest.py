"""A digest of what an episode holds, kept beside it in formats that have none of their own."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from aerial_il.data.episode import Episode

ARRAYS = (
    "actions", "executed_actions", "expert_actions", "is_intervention", "phase", "rewards", "terminated", "truncated",
    "states", "ctrl", "sim_time",
)  # fmt: skip


def content_digest(episode: Episode, spec: Mapping[str, Any] | None = None) -> str:
    """Return the SHA-256 of all values of an episode, their shapes and types, whatever file they lie in.

    Args:
        episode: what is read or written. spec: its specification as a file says it, which may lack what is new.
    """
    spec = episode.spec.to_dict() if spec is None else spec
    identity = {"uid": episode.uid, "success": episode.success, "model": episode.model_xml}
    sha = hashlib.sha256(sealed({**identity, "spec": spec, "provenance": dict(episode.provenance)}))
    arrays = {name: getattr(episode, name) for name in ARRAYS} | {f"obs/{k}": v for k, v in episode.obs.items()}
    for name, values in sorted(arrays.items()):
        sha.update(f"{name} {values.dtype.str} {values.shape}".encode())
        sha.update(np.ascontiguousarray(values).tobytes())
    return sha.hexdigest()


def sealed(tree: Mapping[str, Any]) -> bytes:
    """Return the bytes that a seal on plain values covers: the same for equal values."""
    return json.dumps(tree, sort_keys=True).encode()
