"""The two base classes of a policy file: a frozen configuration that checks itself, and the network that it builds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from aerial_il.core.checks import make_tuples, require_choice, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.normaliser import Scaling

Encoder = Literal["cnn", "resnet18"]


class Seen(NamedTuple):
    """What a network with eyes is shown; one without is shown the state alone.

    Attributes:
        state: (B, To, Do) normalised.
        images: camera field -> (B, To, H, W, 3) uint8.
        labels: camera field -> (B, To, S) what is to be told of each image, NaN where nobody could; no network acts
            on it, and in flight there is none.
    """

    state: Tensor
    images: Mapping[str, Tensor]
    labels: Mapping[str, Tensor] = MappingProxyType({})


Shown = Tensor | Seen


def shown(state: Tensor, images: Mapping[str, Tensor], labels: Mapping[str, Tensor] = MappingProxyType({})) -> Shown:
    """Return what a network is shown: the state (B, To, Do), beside the images where there are any."""
    return Seen(state, images, labels) if images else state


def state_of(obs: Shown) -> Tensor:
    """Return the state (B, To, Do) of what a network is shown."""
    return obs.state if isinstance(obs, Seen) else obs


def with_state(obs: Shown, state: Tensor) -> Shown:
    """Return ``obs`` with another state."""
    return obs._replace(state=state) if isinstance(obs, Seen) else state


class ChunkNetwork(nn.Module, ABC):
    """Maps normalised observation histories to normalised action chunks, and knows what it is trained on.

    A network that acts at random takes its random numbers as a second argument, ``forward(obs, noise=None)`` with
    ``noise`` (B, S) standard normal, so that the caller decides what they depend on (see ``policies/parts/noise.py``).
    Without them it returns its most typical chunk.

    Attributes:
        noise_size: numbers S that one prediction takes.
        redraws: whether each prediction gets new ones; else an episode keeps its own.
        guided: whether it denoises, and can be led while it does: ``forward(obs, noise, guide)``, see ``guiding.py``.
    """

    noise_size: int = 0
    redraws: bool = False
    guided: bool = False

    @property
    def flown(self) -> ChunkNetwork:
        """What of it flies when it is trained; here all of it."""
        return self

    @abstractmethod
    def forward(self, obs: Any) -> Tensor:
        """Return the actions to fly (B, Ta, Da) for ``obs`` (B, To, Do), or :class:`Seen` where it has eyes."""

    @abstractmethod
    def loss(self, obs: Any, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Return the scalar to minimise and named scalars to log.

        Args:
            obs: (B, To, Do), or :class:`Seen`.
            actions: (B, Ta, Da) of the demonstrator.
            valid: (B, Ta), 1 within the episode and 0 after its end.
        """


class StochasticNetwork(ChunkNetwork, ABC):
    """A network that samples its actions and knows their likelihood, so that policy gradients can train it.

    The parameters of its distribution are tensors, as :meth:`distribution` returns them.

    Attributes:
        execute: actions of a sample that are flown before the next one.
    """

    execute: int = 1

    @abstractmethod
    def distribution(self, obs: Tensor) -> tuple[Tensor, ...]:
        """Return the parameters of the distributions for ``obs`` (B, To, Do)."""

    @abstractmethod
    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Sample for ``obs`` (B, To, Do).

        Returns:
            Actions (B, Ta * Da); the samples they were made from (B, R); the log density of these (B,).
        """

    @abstractmethod
    def judge(self, obs: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
        """Return log densities (B,) of samples ``drawn`` (B, R), and entropies (B,) up to a constant."""

    @abstractmethod
    def divergence(self, of: tuple[Tensor, ...], against: tuple[Tensor, ...]) -> Tensor:
        """Return Kullback-Leibler divergences (B,) between two results of :meth:`distribution`."""


@dataclass(frozen=True, kw_only=True)
class PolicySettings(ABC):
    """What the settings mean that all policies have; each policy file states their values, and adds its own.

    Attributes:
        holds_its_end: whether its network is to learn that the last action goes on when the episode is over.
        history: observations To that the network sees, the current one included.
        chunk: actions Ta that it predicts at once.
        execute: steps flown before it predicts again.
        ensemble: decay of the weights over overlapping chunks, oldest first; None flies the newest chunk alone.
        anchor: observation field relative to which the network sees every other position and predicts those of an
            ``ee_pose`` action; None keeps all positions in the world.
        relative: see and predict in the frame of the end effector at the moment of prediction: ``ee_pose`` actions,
            normalised as such, and directions, velocities, orientations and positions relative to the anchor. Its own
            pose is shown in the world.
        obs_names: observation fields; empty for all that are neither images nor named in ``masked_fields``.
        masked_fields: fields, or patterns such as ``target_*`` and ``*``, that the network is not shown; ``to_be_seen``
            stands for all that a robot does not know by itself, such as where objects are. Fields that
            tell what was decided before belong here, such as how far the gripper has closed: a network that sees them
            repeats the decision rather than making it, and cannot recover from a wrong one.
        images: camera fields that it sees beside them, such as ``wrist_rgb``; see :mod:`.vision`.
        encoder: what looks at them: ``cnn``, or ``resnet18`` with random weights.
        image_features: numbers that the encoder makes of each image.
        crop: side of the part of an image that is looked at, as a share of the image's: at random while training, the
            middle in flight.
        action_scaling: ``standard`` or ``minmax``.
        obs_clip: normalised observations are limited to ±``obs_clip``, so that what was never seen cannot overwhelm.
    """

    history: int
    chunk: int
    execute: int
    ensemble: float | None
    anchor: str | None
    relative: bool
    obs_names: tuple[str, ...]
    masked_fields: tuple[str, ...]
    images: tuple[str, ...]
    encoder: Encoder
    image_features: int
    crop: float
    action_scaling: Scaling
    obs_clip: float

    holds_its_end: ClassVar[bool] = False

    def __post_init__(self) -> None:
        make_tuples(self)
        require_positive(self, "history", "chunk", "obs_clip", "image_features", "crop")
        require_share(self, "crop")
        require_choice(self, "encoder", Encoder)
        if not 1 <= self.execute <= self.chunk:
            raise InvalidValueError(f"execute is {self.execute}; it must lie in [1, {self.chunk}], the chunk.")

    @property
    def name(self) -> str:
        """The registry name: that of the file."""
        return type(self).__module__.rpartition(".")[2]

    @abstractmethod
    def build(self, obs_size: int, action_size: int) -> ChunkNetwork:
        """Return a new network with random weights for observations of Do and actions of Da elements."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for YAML."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self).items()}


def masked_mean(values: Tensor, valid: Tensor) -> Tensor:
    """Return the mean of ``values`` (B, Ta, Da) over the steps where ``valid`` (B, Ta) is 1."""
    return (values.mean(-1) * valid).sum() / torch.clamp(valid.sum(), min=1.0)


def without_gaps(actions: Tensor, valid: Tensor) -> Tensor:
    """Return ``actions`` (B, Ta, Da), where ``valid`` (B, Ta) is 0 those of the valid step before, or of the first one.

    A network that sees a chunk on its way to another must see whole ones, in training as in flight.
    """
    place, known = torch.arange(actions.shape[1], device=actions.device), valid > 0.5
    first = known.long().argmax(-1, keepdim=True)
    index = torch.where(known, place, first).cummax(-1).values
    return actions.gather(1, index[..., None].expand_as(actions))


def squared_error(answers: Tensor, targets: Tensor, valid: Tensor) -> Tensor:
    """Return the mean squared error of ``answers`` (B, Ta, Da) over the steps where ``valid`` (B, Ta) is 1."""
    counts = valid[..., None]
    error = functional.mse_loss(answers * counts, targets * counts)
    return error * (valid.numel() / valid.sum().clamp(min=1.0))
