"""Policies that Stable-Baselines3 has trained and saved, flown without it: nothing of the file is unpickled.

Its zip holds the weights (``policy.pth``, tensors alone) and, in ``data``, JSON with pickles inside, of which only the
text beside them is read. Flown are the deterministic actions of PPO, A2C, SAC, TD3 and DDPG with perceptrons, over a
vector or a dictionary of vectors; a vector has the fields in the order of their names, as Gymnasium's
``FlattenObservation`` joins them. Among discrete actions the one of the highest score is answered, a 1 among zeros.
"""

import io
import pickle
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.core.bounded import MAX_UNPACKED_BYTES, parse_json, read_bytes
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.core.files import sha256_of

ENDING = ".zip"
ACTIVATIONS: Mapping[str, Callable[[], nn.Module]] = {
    name: getattr(nn, name) for name in ("Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "GELU", "Sigmoid")
}
# what the weights of the acting network are called, in order -> default activation, and whether tanh bounds its answer
KINDS = {
    ("mlp_extractor.policy_net", "action_net"): ("Tanh", False),  # PPO, A2C
    ("actor.latent_pi", "actor.mu"): ("ReLU", True),  # SAC; TD3 and DDPG have the second alone
}
SPACES = ("Box", "Discrete")  # of actions
FAULTS = (
    zipfile.BadZipFile, pickle.UnpicklingError, OSError, EOFError, ValueError, LookupError, RuntimeError,
    AttributeError, TypeError,
)  # fmt: skip
_FIELD = re.compile(r"'(\w+)': Box\(")
_NUMBER = re.compile(r"-?inf|-?\d+\.?\d*(?:e[-+]\d+)?")
OTHERWISE = "Fly it as policy=MODULE:FACTORY."


class Sb3Policy:
    """A deterministic policy of Stable-Baselines3 behind our interface.

    Args:
        path: its zip.

    Attributes:
        sha256: of the zip.

    Raises:
        CheckpointError: it is none, is too large, or its network is of another kind.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.exists():
            near = get_close_matches(self.path.name, [file.name for file in self.path.parent.glob(f"*{ENDING}")], 1)
            raise CheckpointError(self.path, "does not exist.", f"Did you mean {near[0]}?" if near else "")
        try:
            self._saved = _read(self.path)
        except CheckpointError:
            raise
        except FAULTS as error:
            raise CheckpointError(self.path, f"cannot be read as a policy of Stable-Baselines3 ({error!r}).") from error
        self.sha256 = sha256_of(self.path)
        self._low = self._high = np.zeros(0)

    def attach(self, env: BatchEnv) -> None:
        """Take over the bounds and the fields of an environment.

        Raises:
            InvalidValueError: its observations or actions are of another size, its actions were limited otherwise and
                are not stretched, or it chooses and has nothing to choose.
        """
        spec = env.spec
        self._low, self._high = spec.action.low, spec.action.high
        self._names: Sequence[str] = self._saved.fields or sorted(spec.observation.state_names)
        linear = [layer for layer in self._saved.network if isinstance(layer, nn.Linear)]
        seen = spec.observation.size(self._names)
        if (linear[0].in_features, linear[-1].out_features) != (seen, spec.action.size):
            mapped = f"maps {linear[0].in_features} numbers to {linear[-1].out_features}"
            there = f"{spec.robot}/{spec.task} shows {seen} and takes {spec.action.size}"
            raise InvalidValueError(f"{self.path} {mapped}; {there}.")
        if self._saved.chooses and ((self._low != 0) | (self._high != 1)).any():
            raise InvalidValueError(
                f"{self.path} chooses one of {spec.action.size} actions; {spec.robot}/{spec.task} takes numbers, not "
                "scores from 0 to 1. Fly it in the environment that it was trained in: env=gymnasium:NAME"
            )
        trained, flown = self._saved.limits, np.array([self._low, self._high])
        if not self._saved.bounded and trained.shape == flown.shape and not np.allclose(trained, flown, rtol=1e-5):
            raise InvalidValueError(
                f"{self.path} was trained with actions from {trained[0]} to {trained[1]}; "
                f"{spec.robot}/{spec.task} takes them from {self._low} to {self._high}. {OTHERWISE}"
            )

    def reset(self, mask: np.ndarray | None = None) -> None:
        """It has no state."""

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) within the bounds."""
        flat = np.concatenate([np.asarray(obs[n], np.float32).reshape(len(obs[n]), -1) for n in self._names], axis=1)
        with torch.no_grad():
            answers = np.concatenate([self._saved.network(torch.from_numpy(row[None])).numpy() for row in flat])
        if self._saved.chooses:
            return np.eye(answers.shape[1])[answers.argmax(1)]
        if self._saved.bounded:
            answers = self._low + 0.5 * (np.tanh(answers) + 1.0) * (self._high - self._low)
        return np.clip(answers, self._low, self._high).astype(float)


class _Saved(NamedTuple):
    """What a file holds.

    Attributes:
        network: observations to answers. fields: names of what it sees; none for a vector.
        bounded: whether tanh bounds its answers. chooses: whether they are scores of discrete actions.
        limits: (2, Da) the least and the greatest actions that it was trained with; (2, 0) where the file tells none.
    """

    network: nn.Sequential
    fields: tuple[str, ...]
    bounded: bool
    chooses: bool
    limits: np.ndarray


def _read(path: Path) -> _Saved:
    with zipfile.ZipFile(io.BytesIO(read_bytes(path, most=MAX_UNPACKED_BYTES))) as archive:
        wanted = [archive.getinfo(name) for name in ("data", "policy.pth")]
        if (size := sum(entry.file_size for entry in wanted)) > MAX_UNPACKED_BYTES:
            raise CheckpointError(path, f"would unpack to {size} bytes.")
        saved, raw = parse_json(archive.read("data")), archive.read("policy.pth")
    weights = torch.load(io.BytesIO(raw), map_location="cpu", weights_only=True)
    _require_plain(path, saved, weights)
    for parts, (activation, bounded) in KINDS.items():
        layers = [layer for part in parts for layer in _layers(weights, part)]
        if layers and any(name.startswith(f"{parts[-1]}.") for name in weights):
            network = _network(layers, _activation(path, saved, activation))
            return _Saved(network, _fields(saved), bounded, _chooses(path, saved), _limits(saved))
    raise CheckpointError(path, "is no perceptron of PPO, A2C, SAC, TD3 or DDPG.", OTHERWISE)


def _require_plain(path: Path, saved: Mapping[str, Any], weights: Mapping[str, Tensor]) -> None:
    """Refuse what acts through more than the perceptron."""
    more = {
        "a features extractor that was learned": any("features_extractor" in name for name in weights),
        "squashed actions (squash_output)": str((saved.get("policy_kwargs") or {}).get("squash_output")) == "True",
        "clipped means (use_sde)": bool(saved.get("use_sde"))
        and any(name.startswith("actor.mu.0") for name in weights),
    }
    for what in (what for what, there in more.items() if there):
        raise CheckpointError(path, f"has {what}, which are not flown here.", OTHERWISE)


def _limits(saved: Mapping[str, Any]) -> np.ndarray:
    """Return (2, Da) the least and the greatest actions; (2, 0) where the file does not tell them in numbers."""
    space = saved.get("action_space") or {}
    low, high = ([float(number) for number in _NUMBER.findall(str(space.get(end, "")))] for end in ("low", "high"))
    return np.array([low, high]) if len(low) == len(high) else np.zeros((2, 0))


def _layers(weights: Mapping[str, Tensor], part: str) -> list[tuple[Tensor, Tensor]]:
    """Return weight and bias of the layers of a part, in order."""
    pattern = re.compile(rf"{re.escape(part)}(?:\.(\d+))?\.weight")
    matched = sorted((int(m[1] or 0), name) for name in weights if (m := pattern.fullmatch(name)))
    return [(weights[name], weights[f"{name.removesuffix('weight')}bias"]) for _, name in matched]


def _network(layers: Sequence[tuple[Tensor, Tensor]], activation: Callable[[], nn.Module]) -> nn.Sequential:
    modules: list[nn.Module] = []
    for weight, bias in layers:
        linear = nn.Linear(weight.shape[1], weight.shape[0])
        linear.load_state_dict({"weight": weight, "bias": bias})
        modules += [linear, activation()]
    return nn.Sequential(*modules[:-1]).eval()


def _activation(path: Path, saved: Mapping[str, Any], default: str) -> Callable[[], nn.Module]:
    said = str((saved.get("policy_kwargs") or {}).get("activation_fn", default))
    name = _class_name(said)
    if name not in ACTIVATIONS:
        raise CheckpointError(
            path, f"has an activation {said} that is not known here.", f"Known: {', '.join(ACTIVATIONS)}."
        )
    return ACTIVATIONS[name]


def _fields(saved: Mapping[str, Any]) -> tuple[str, ...]:
    space = saved.get("observation_space") or {}
    return tuple(_FIELD.findall(str(space.get("spaces", ""))))


def _chooses(path: Path, saved: Mapping[str, Any]) -> bool:
    said = str((saved.get("action_space") or {}).get(":type:", ""))
    if _class_name(said) not in SPACES:
        hint = f"Flown are {' and '.join(SPACES)}. {OTHERWISE}"
        raise CheckpointError(path, f"acts in a space {said} that is not known here.", hint)
    return _class_name(said) == "Discrete"


def _class_name(said: str) -> str:
    """Return the name of a class from its text, ``<class 'package.module.Name'>``."""
    return re.split(r"\W", said.rstrip("'>"))[-1]
