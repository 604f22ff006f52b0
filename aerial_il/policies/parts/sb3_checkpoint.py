"""Policies that Stable-Baselines3 has trained and saved, flown without it: nothing of the file is unpickled.

Its zip holds the weights (``policy.pth``, tensors alone) and, in ``data``, JSON with pickles inside, of which only the
text beside them is read. Flown are the deterministic actions of PPO, A2C, SAC, TD3 and DDPG with perceptrons, over a
vector or a dictionary of vectors.
"""

from __future__ import annotations

import io
import pickle
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.core.bounded import MAX_UNPACKED_BYTES, parse_json, read_bytes
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import CheckpointError, InvalidValueError

ENDING = ".zip"
ACTIVATIONS: Mapping[str, Callable[[], nn.Module]] = {
    name: getattr(nn, name) for name in ("Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "GELU", "Sigmoid")
}
# what the weights of the acting network are called, in order -> usual activation, and whether tanh bounds its answer
KINDS = {
    ("mlp_extractor.policy_net", "action_net"): ("Tanh", False),  # PPO, A2C
    ("actor.latent_pi", "actor.mu"): ("ReLU", True),  # SAC; TD3 and DDPG have the second alone
}
FAULTS = (
    zipfile.BadZipFile, pickle.UnpicklingError, OSError, EOFError, ValueError, LookupError, RuntimeError,
    AttributeError, TypeError,
)  # fmt: skip
_FIELD = re.compile(r"'(\w+)': Box\(")


class Sb3Policy:
    """A deterministic policy of Stable-Baselines3 behind our interface.

    Args:
        path: its zip.

    Raises:
        CheckpointError: it is none, is too large, or its network is of another kind.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self._network, self._fields, self._bounded = _read(self.path)
        except CheckpointError:
            raise
        except FAULTS as error:
            raise CheckpointError(self.path, f"cannot be read as a policy of Stable-Baselines3 ({error!r}).") from error
        self._low = self._high = np.zeros(0)

    def attach(self, env: BatchEnv) -> None:
        """Take over the bounds and the fields of an environment.

        Raises:
            InvalidValueError: its observations or actions are of another size.
        """
        spec = env.spec
        self._low, self._high = spec.action.low, spec.action.high
        self._names: Sequence[str] = self._fields or spec.observation.state_names
        linear = [layer for layer in self._network if isinstance(layer, nn.Linear)]
        seen = spec.observation.size(self._names)
        if (linear[0].in_features, linear[-1].out_features) != (seen, spec.action.size):
            mapped = f"maps {linear[0].in_features} numbers to {linear[-1].out_features}"
            there = f"{spec.robot}/{spec.task} shows {seen} and takes {spec.action.size}"
            raise InvalidValueError(f"{self.path} {mapped}; {there}.")

    def reset(self, mask: np.ndarray | None = None) -> None:
        """It has no state."""

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) within the bounds."""
        flat = np.concatenate([np.asarray(obs[n], np.float32).reshape(len(obs[n]), -1) for n in self._names], axis=1)
        with torch.no_grad():
            answers = np.concatenate([self._network(torch.from_numpy(row[None])).numpy() for row in flat])
        if self._bounded:
            answers = self._low + 0.5 * (np.tanh(answers) + 1.0) * (self._high - self._low)
        return np.clip(answers, self._low, self._high).astype(float)


def _read(path: Path) -> tuple[nn.Sequential, tuple[str, ...], bool]:
    """Return the network, the names of the fields that it sees (none for a vector), and whether tanh bounds it."""
    with zipfile.ZipFile(io.BytesIO(read_bytes(path, most=MAX_UNPACKED_BYTES))) as archive:
        wanted = [archive.getinfo(name) for name in ("data", "policy.pth")]
        if (size := sum(entry.file_size for entry in wanted)) > MAX_UNPACKED_BYTES:
            raise CheckpointError(path, f"would unpack to {size} bytes.")
        saved, raw = parse_json(archive.read("data")), archive.read("policy.pth")
    weights = torch.load(io.BytesIO(raw), map_location="cpu", weights_only=True)
    for parts, (activation, bounded) in KINDS.items():
        layers = [layer for part in parts for layer in _layers(weights, part)]
        if layers and any(name.startswith(f"{parts[-1]}.") for name in weights):
            return _network(layers, _activation(path, saved, activation)), _fields(saved), bounded
    raise CheckpointError(path, "is no perceptron of PPO, A2C, SAC, TD3 or DDPG.", "Fly it as policy=MODULE:FACTORY.")


def _layers(weights: Mapping[str, Tensor], part: str) -> list[tuple[Tensor, Tensor]]:
    """Return weight and bias of the layers of a part, in order."""
    found = re.compile(rf"{re.escape(part)}(?:\.(\d+))?\.weight")
    matched = sorted((int(m[1] or 0), name) for name in weights if (m := found.fullmatch(name)))
    return [(weights[name], weights[f"{name.removesuffix('weight')}bias"]) for _, name in matched]


def _network(layers: Sequence[tuple[Tensor, Tensor]], activation: Callable[[], nn.Module]) -> nn.Sequential:
    modules: list[nn.Module] = []
    for weight, bias in layers:
        linear = nn.Linear(weight.shape[1], weight.shape[0])
        linear.load_state_dict({"weight": weight, "bias": bias})
        modules += [linear, activation()]
    return nn.Sequential(*modules[:-1]).eval()


def _activation(path: Path, saved: Mapping[str, Any], usual: str) -> Callable[[], nn.Module]:
    said = str((saved.get("policy_kwargs") or {}).get("activation_fn", usual))
    name = re.split(r"\W", said.rstrip("'>"))[-1]
    if name not in ACTIVATIONS:
        raise CheckpointError(
            path, f"has an activation {said} that is not known here.", f"Known: {', '.join(ACTIVATIONS)}."
        )
    return ACTIVATIONS[name]


def _fields(saved: Mapping[str, Any]) -> tuple[str, ...]:
    space = saved.get("observation_space") or {}
    return tuple(_FIELD.findall(str(space.get("spaces", ""))))
