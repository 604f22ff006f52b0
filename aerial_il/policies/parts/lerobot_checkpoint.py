"""Policies that lerobot has trained and saved, flown in n worlds at once by our evaluation.

Network, normalisation and sizes are lerobot's, read from its own files: ``config.json``, ``model.safetensors`` and the
two processors. Chunks are executed as lerobot does (``n_action_steps`` of each, or a temporal ensemble), but for each
world by itself, so that worlds may be reset at different times, and what a diffusion policy draws in one does not
depend on the others. Nothing is unpickled, downloaded, or imported because a
file names it: steps of a processor other than those below are refused.
"""

import hashlib
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.bounded import read_json
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import CheckpointError, InvalidValueError, NonFiniteActionError
from aerial_il.core.files import sha256_of
from aerial_il.core.lerobot_names import ACTION, IMAGES, STATE
from aerial_il.core.specs import EnvSpec, Field, image_name
from aerial_il.policies.parts.chunking import ActionPlan, ObservationHistory
from aerial_il.policies.parts.noise import EpisodeNoise, glimpses

CONFIG, TRAINING = "config.json", "train_config.json"
PROCESSORS = ("policy_preprocessor.json", "policy_postprocessor.json")
STEPS = ("rename_observations_processor", "to_batch_processor", "device_processor", "normalizer_processor",
         "unnormalizer_processor")  # fmt: skip
KINDS = ("act", "diffusion")


class LerobotPolicy:
    """A policy of lerobot behind our interface.

    Args:
        folder: with ``config.json`` and ``model.safetensors``.

    Attributes:
        cameras: that it looks through, with the sizes of their images, such as ``wrist@64x64``.
        cell: robot and task that its dataset tells, or None. sha256: of its files.

    Raises:
        CheckpointError: it is incomplete, of a kind that cannot be flown, or names code to run.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        _check_files(folder)
        os.environ.setdefault("HF_HUB_OFFLINE", "1")
        config = self._config = _load_config(folder)
        self._inputs = {name: tuple(feature.shape) for name, feature in config.input_features.items()}
        self._size = int(config.output_features[ACTION].shape[0])
        images = {n.removeprefix(IMAGES): shape for n, shape in self._inputs.items() if n.startswith(IMAGES)}
        self.cameras = tuple(f"{name}@{height}x{width}" for name, (_, height, width) in images.items())
        self.cell = _cell(folder)
        self.sha256 = _digest(folder)
        self._policy, self._encode, self._decode = _load(folder, config)
        execute, ensemble = int(config.n_action_steps), getattr(config, "temporal_ensemble_coeff", None)
        chunk = int(config.chunk_size) if config.type == "act" else execute
        self._plan = ActionPlan(chunk, execute, ensemble)
        self._histories = {name: ObservationHistory(int(config.n_obs_steps)) for name in self._inputs}
        self._shape = (config.horizon, self._size) if config.type == "diffusion" else (0, 0)
        self._noise = EpisodeNoise(math.prod(self._shape), redraw=True)
        self._spec: EnvSpec | None = None
        self.reset()

    def attach(self, env: BatchEnv) -> None:
        """Take the environment's specification, whose sizes must be those that the policy was trained with.

        Raises:
            InvalidValueError: they are not; names both.
        """
        shown = {name: _shape(env.spec, name) for name in self._inputs}
        wanted = {**self._inputs, ACTION: (self._size,)}
        found = {**shown, ACTION: (env.spec.action.size,)}
        if differing := [f"{n}: {wanted[n]} != {found[n]}" for n in wanted if wanted[n] != found[n]]:
            raise InvalidValueError(
                f"{self.folder} was trained with other observations or actions than {env.spec.task} on "
                f"{env.spec.robot} has: {'; '.join(differing)}."
            )
        self._spec = env.spec

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) within their bounds for observations ``name -> (n, ...)``.

        Raises:
            NonFiniteActionError: NaN or infinity in the network's output.
        """
        spec = self._spec
        if spec is None:
            raise InvalidValueError("A policy of lerobot must be attached to an environment before it acts.")
        shown = {name: _read(spec, name, obs) for name in self._inputs}
        seen = {name: self._histories[name].push(values) for name, values in shown.items()}
        due = self._plan.due(len(next(iter(shown.values()))))
        if due.any():
            noise = self._noise.take(_first_seen(shown), due) if self._noise.size else None
            self._plan.add(self._predict({n: h[due] for n, h in seen.items()}, np.flatnonzero(due), noise), due)
        return spec.action.clip(self._plan.pop().astype(np.float64))

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the memory of the worlds in ``mask`` (n,) bool, or of all of them and their number."""
        for memory in (*self._histories.values(), self._plan, self._noise):
            memory.reset(mask)

    def _predict(self, histories: Mapping[str, np.ndarray], worlds: np.ndarray, noise: np.ndarray | None) -> np.ndarray:
        """Return chunks of actions (B, Ta, Da) in the environment's units for histories ``name -> (B, To, ...)``.

        A chunk begins as ``noise`` (B, S) where there is chance. A sampler that draws on the way, DDPM's, does so from
        torch's one generator: world by world then, each from a seed of its own.
        """
        single = self._config.n_obs_steps == 1
        batch = {name: _to_tensor(name, h[:, 0] if single and self._config.type == "act" else h)
                 for name, h in histories.items()}  # fmt: skip
        alone = noise is not None and self._config.noise_scheduler_type == "DDPM"
        parts = [slice(i, i + 1) for i in range(len(worlds))] if alone else [slice(None)]
        seeds = noise[:, :1].copy().view(np.uint32)[:, 0].tolist() if noise is not None and alone else [0]
        begun = {} if noise is None else {"noise": torch.from_numpy(noise).unflatten(1, self._shape)}
        chunks = []
        with torch.inference_mode(), torch.random.fork_rng():
            for rows, seed in zip(parts, seeds, strict=True):
                torch.manual_seed(seed)
                encoded = self._encode({name: values[rows] for name, values in batch.items()})
                chunk = self._policy.predict_action_chunk(encoded, **{name: each[rows] for name, each in begun.items()})
                chunks.append(self._decode(chunk[:, : self._plan.chunk]).cpu().numpy())
        actions = np.concatenate(chunks)
        if not np.isfinite(actions).all():
            raise NonFiniteActionError("network output", worlds[~np.isfinite(actions).all(axis=(1, 2))])
        return actions


def _check_files(folder: Path) -> None:
    """Require that the processors consist of known steps, which their files name by registry, not by module."""
    for name in PROCESSORS:
        try:
            steps = read_json(folder / name)["steps"]
            known = [step.get("registry_name") for step in steps]
            states = [step.get("state_file", "x.safetensors") for step in steps]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise CheckpointError(folder / name, f"cannot be read ({error!r}).") from error
        if strange := [step for step in known if step not in STEPS]:
            raise CheckpointError(folder / name, f"has steps {strange} that are not run; known: {', '.join(STEPS)}.")
        if any(Path(state).name != state or not state.endswith(".safetensors") for state in states):
            raise CheckpointError(folder / name, f"names state files outside of it or of another kind: {states}.")


def _digest(folder: Path) -> str:
    """Return the SHA-256 of the names and contents of all that decides how it flies."""
    files = sorted(path for path in folder.iterdir() if path.suffix in (".json", ".safetensors") and path.is_file())
    return hashlib.sha256("".join(f"{path.name} {sha256_of(path)}\n" for path in files).encode()).hexdigest()


def _load_config(folder: Path) -> Any:
    try:
        raw = read_json(folder / CONFIG)
        kind = raw.get("type")
    except (OSError, ValueError, AttributeError) as error:
        raise CheckpointError(folder / CONFIG, f"cannot be read ({error!r}).") from error
    if kind not in KINDS:
        raise CheckpointError(folder, f"is a policy of kind {kind!r}; those of kind {', '.join(KINDS)} can be flown.")
    from lerobot.configs import PreTrainedConfig
    from lerobot.policies import get_policy_class

    get_policy_class(kind)  # registers the kind
    try:
        config: Any = PreTrainedConfig.from_pretrained(folder)
    except Exception as error:  # draccus has errors of many kinds
        raise CheckpointError(folder / CONFIG, f"is no configuration of lerobot ({error}).") from error
    config.pretrained_backbone_weights = None  # they are in the file: nothing to download
    config.device = "cpu"
    return config


def _load(folder: Path, config: Any) -> tuple[Any, Any, Any]:
    """Return the network, what prepares its input, and what turns its output into actions."""
    from lerobot.policies import get_policy_class, make_pre_post_processors

    try:
        policy = get_policy_class(config.type).from_pretrained(folder, config=config, strict=True)
        overrides = {"device_processor": {"device": "cpu"}}
        encode, decode = make_pre_post_processors(config, str(folder), preprocessor_overrides=overrides)
    except Exception as error:  # whatever lerobot, safetensors or torch make of a damaged file
        raise CheckpointError(folder, f"cannot be loaded ({type(error).__name__}: {error}).") from error
    return policy.eval(), encode, decode


def _cell(folder: Path) -> tuple[str, str] | None:
    """Return robot and task as the name of the dataset, ``local/ROBOT-TASK``, tells them."""
    try:
        name = read_json(folder / TRAINING)["dataset"]["repo_id"]
        robot, task = str(name).removeprefix("local/").split("-")
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return robot, task


def _members(spec: EnvSpec, name: str) -> tuple[Field, ...]:
    return spec.observation.of_group("proprio" if name == STATE else "task")


def _shape(spec: EnvSpec, name: str) -> tuple[int, ...] | None:
    """Return the shape that ``spec`` gives lerobot's feature ``name``, images with their channels first."""
    if name.startswith(IMAGES):
        field = image_name(name.removeprefix(IMAGES))
        if field not in spec.observation.names:
            return None
        height, width, channels = spec.observation[field].shape
        return channels, height, width
    return (sum(f.size for f in _members(spec, name)),)


def _read(spec: EnvSpec, name: str, obs: Observation) -> np.ndarray:
    """Return the feature ``name`` of n worlds (n, ...)."""
    if name.startswith(IMAGES):
        return obs[image_name(name.removeprefix(IMAGES))]
    return spec.observation.flatten(obs, [f.name for f in _members(spec, name)])


def _first_seen(shown: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return numbers (n, C) that tell worlds from each other: their states, or pictures where they have none."""
    states = [values for name, values in shown.items() if not name.startswith(IMAGES)]
    return np.concatenate(states, axis=1) if states else glimpses([*shown.values()])


def _to_tensor(name: str, values: np.ndarray) -> Tensor:
    """Return float32, images as lerobot reads them: channels first, from 0 to 1."""
    tensor = torch.from_numpy(np.ascontiguousarray(values)).float()
    return tensor.movedim(-1, -3) / 255 if name.startswith(IMAGES) else tensor
