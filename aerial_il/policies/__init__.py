"""Policies: one file each, its network and its settings; what several share lies in ``parts``."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core import registry
from aerial_il.core.errors import AerialError, CheckpointError, InvalidValueError
from aerial_il.core.renamed import moved

if TYPE_CHECKING:
    from aerial_il.core.checkpoint import Checkpoint
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy
    from aerial_il.policies.parts.exported import OnnxPolicy
    from aerial_il.policies.parts.lerobot_checkpoint import LerobotPolicy
    from aerial_il.policies.parts.network import PolicySettings

FINAL = "policy"  # folder of a run that holds the finished policy


def names() -> tuple[str, ...]:
    """Return the names of all policies, without importing them."""
    return registry.names("policy")


def get(name: str) -> type[PolicySettings]:
    """Return the class of settings that the policy file ``name`` defines.

    Raises:
        UnknownNameError: no policy has that name.
    """
    return registry.get("policy", name)


def load_policy(path: str | os.PathLike[str]) -> ChunkPolicy:
    """Load a policy that can fly at once.

    Args:
        path: a saved policy, one checkpoint, or a run folder: its finished policy, else its newest valid checkpoint.

    Raises:
        CheckpointError: there is none, or what there is has been cut or altered.
    """
    folder, saved = _find(Path(path))
    try:
        return _rebuilt(saved)
    except (AerialError, LookupError, TypeError, ValueError, RuntimeError, AttributeError, OverflowError) as error:
        raise CheckpointError(folder, f"is no policy that this release can rebuild ({error}).") from error


def _rebuilt(saved: Checkpoint) -> ChunkPolicy:
    """Return the policy that was saved, beside its prior where it has one."""
    from aerial_il.core.checkpoint import Checkpoint
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy
    from aerial_il.policies.parts.gated import GATE, GatedPolicy
    from aerial_il.policies.parts.residual import RESIDUAL, ResidualPolicy
    from aerial_il.policies.perception.policy import PERCEPTION, PerceivingPolicy

    if RESIDUAL in saved.config:
        return ResidualPolicy.around(saved, _rebuilt)
    if PERCEPTION in saved.config:
        return PerceivingPolicy.around(saved, _rebuilt)

    kind = get(saved.config["policy"])
    known = [each.name for each in fields(kind)]
    settings = {
        name if name in known else moved(name, known) or name: v for name, v in saved.config["settings"].items()
    }
    if unsaid := [each.name for each in fields(kind) if each.init and each.name not in settings]:
        raise InvalidValueError(f"saved by another release, it does not say {', '.join(unsaid)}; train it again")
    arrays = {name.replace(".worth.", ".value."): array for name, array in saved.arrays.items()}  # as it was called
    policy = ChunkPolicy.from_checkpoint(Checkpoint(arrays, saved.state, saved.config), kind(**settings))
    return GatedPolicy.around(policy, saved, _rebuilt) if GATE in saved.config else policy


def load_any_policy(path: str | os.PathLike[str]) -> ChunkPolicy | LerobotPolicy | OnnxPolicy:
    """Load a policy of ours, one that was exported, or one that lerobot has trained and saved.

    Raises:
        CheckpointError: there is none, or what there is has been cut or altered.
    """
    if found := find_lerobot(Path(path)):
        from aerial_il.policies.parts.lerobot_checkpoint import LerobotPolicy

        return LerobotPolicy(found)
    return load_flying(path)


def load_flying(path: str | os.PathLike[str]) -> ChunkPolicy | OnnxPolicy:
    """Load a policy of ours, or one that was exported; raises as :func:`load_policy`."""
    from aerial_il.policies.parts.exported import GRAPH, load_exported

    return load_exported(Path(path)) if (Path(path) / GRAPH).is_file() else load_policy(path)


def find_lerobot(path: Path) -> Path | None:
    """Return the folder of the policy that lerobot saved at ``path``, a run of its trainer included, or None."""
    places = (path, path / "pretrained_model", path / "checkpoints" / "last" / "pretrained_model")
    return next((p for p in places if (p / "config.json").is_file() and (p / "model.safetensors").is_file()), None)


def _find(path: Path) -> tuple[Path, Checkpoint]:
    from aerial_il.core import checkpoint

    if checkpoint.is_sealed(path):
        return path, checkpoint.load(path)
    if checkpoint.is_sealed(path / FINAL):
        try:
            return path / FINAL, checkpoint.load(path / FINAL)
        except CheckpointError as error:
            checkpoint.log.warning("Finished policy refused, trying the run's checkpoints. %s", error)
    if found := checkpoint.latest(path):
        return found
    problem = "does not exist." if not path.exists() else "holds neither a policy nor a run's checkpoints."
    raise CheckpointError(path, problem, "Train one: aerial-il train algorithm=bc dataset=PATH run=runs/NAME")
