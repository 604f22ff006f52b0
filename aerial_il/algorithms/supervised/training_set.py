"""Training sets: demonstrations checked, split, normalised, in minibatches of tensors."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.seeing.auxiliary import Hidden
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError
from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import EnvSpec
from aerial_il.core.tensors import tensor
from aerial_il.data.dataset import Dataset
from aerial_il.data.episode import Episode
from aerial_il.data.memory import MEMORY
from aerial_il.data.windows import Batch, Frames, Windows
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout, to_offsets
from aerial_il.policies.parts.network import PolicySettings, Shown, shown
from aerial_il.policies.parts.normaliser import Normaliser, Samples
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.parts.tasks import unite

NO_LABELS: Frames = MappingProxyType({})
GIB, ROOM = 2**30, 0.9  # the share of the room that is taken
BLOCK = 8192  # windows at once
IMAGES_AT_ONCE = 256  # windows whose images are encoded in one go outside training
VALIDATE = "Find out more: aerial-il validate PATH"


class Demonstrations(NamedTuple):
    """What a run learns from.

    Attributes:
        layout: how the policy sees the episodes.
        kept, weights: episodes to train on, and how much each counts (E,).
        held_out: episodes to validate on.
    """

    layout: Layout
    kept: list[Episode]
    weights: np.ndarray
    held_out: list[Episode]


def read_demos(
    dataset: Iterable[Episode], policy: PolicySettings, *, failures: bool = False
) -> tuple[Layout, list[Episode]]:
    """Return the successful episodes, or all of them, and the layout ``policy`` sees them in.

    Whatever nothing should learn from is refused.

    Raises:
        InvalidValueError: there is no success, episodes come from different environments, a value is not finite, or
            there is no room for them.
        UnknownNameError: the episodes lack an observation field.
    """
    demos = [episode for episode in _held(dataset) if episode.success or failures]
    if not demos:
        hint = "Record some: aerial-il collect robot=R task=T episodes=100 out=datasets/NAME"
        raise InvalidValueError(f"The dataset holds no successful demonstration. {hint}")
    demos = unite(demos)
    layout = Layout.of(demos[0].spec, policy)
    for episode in demos:
        _check(episode, layout)
    return layout, demos


def _held(dataset: Iterable[Episode]) -> Iterator[Episode]:
    """Yield the episodes, which are kept by the caller, as long as there is room for those to come."""
    count, held = len(dataset) if isinstance(dataset, Dataset) else 0, 0  # others are in memory already
    for number, episode in enumerate(dataset, start=1):
        held += episode.nbytes
        to_come, room = held // number * (count - number), MEMORY.room_bytes()
        if to_come > ROOM * room:
            size, limit = f"{(held + to_come) / GIB:.1f} GiB", f"{(held + room) / GIB:.1f} GiB"
            raise InvalidValueError(
                f"{count} episodes take about {size}; there is room for {limit}, in memory and in files "
                "(see dataset.held_mb, TMPDIR). Train on fewer episodes (dataset.episodes=N), on fewer cameras "
                "(policy.images=[...]), or on smaller images (aerial-il collect image_size=[64,64])."
            )
        yield MEMORY.keep(episode) if count else episode


def _check(episode: Episode, layout: Layout) -> None:
    if differing := layout.spec.differences(episode.spec):
        raise InvalidValueError(f"Episode {episode.uid} comes from another environment: {'; '.join(differing)}.")
    try:
        layout.flatten(episode.obs)
    except NonFiniteActionError as error:
        where = f"at step {min(error.worlds)}"  # the leading axis of one episode is time
        raise InvalidValueError(f"Episode {episode.uid}: {error.what} is not finite {where}. {VALIDATE}") from error
    finite = np.isfinite(episode.executed_actions).all(1)
    if not finite.all():
        where = f"at step {int(np.argmin(finite))}"
        raise InvalidValueError(f"Episode {episode.uid}: the action is not finite {where}. {VALIDATE}")


def check_recorded(spec: EnvSpec, expect: Mapping[str, str]) -> None:
    """Raise :class:`InvalidValueError` unless a dataset of ``spec`` was recorded as expected.

    Args:
        spec: of its environment.
        expect: any of ``robot``, ``task``, ``tier``, ``action`` (level) and ``cameras`` (commas between).
    """
    cameras = ",".join(f.name for f in spec.observation.of_group("image")) or "none"
    has = {"robot": spec.robot, "task": spec.task, "tier": spec.tier, "action": spec.action.level, "cameras": cameras}
    for key, wanted in expect.items():
        if has[key] != wanted:
            raise InvalidValueError(f"The dataset was recorded with {key}={has[key]}; {key}={wanted} was asked for.")


def split[T](demos: Sequence[T], fraction: float, *, seed: int) -> tuple[list[T], list[T]]:
    """Draw ``fraction`` of the demonstrations, at least one where there are two, for validation.

    Returns:
        Those to train on and those to validate on, each in their order.
    """
    count = min(len(demos) - 1, max(1, round(fraction * len(demos)))) if fraction > 0 else 0
    held = set(named_rng(seed, "validation split").permutation(len(demos))[:count].tolist())
    return [d for i, d in enumerate(demos) if i not in held], [d for i, d in enumerate(demos) if i in held]


def cut_windows(demos: Sequence[Episode], layout: Layout, policy: PolicySettings) -> Windows:
    """Cut ``demos`` into windows, labelled by the expert where it was asked, else by what was flown.

    Raises:
        InvalidValueError: a chunk is longer than any episode of the environment may last.
    """
    spec = demos[0].spec
    if policy.chunk > spec.max_steps and not spec.is_foreign:
        problem = f"policy.chunk={policy.chunk} must not be longer than an episode, {spec.max_steps} steps"
        raise InvalidValueError(f"{problem}. Chunks of 10 to 50 are common.")
    return Windows(
        demos,
        layout.names,
        history=policy.history,
        chunk=policy.chunk,
        target="expert_actions",
        successes_only=False,
        images=layout.images,
    )


def window_weights(weights: np.ndarray, windows: Windows) -> np.ndarray | None:
    """Return the weight of each window (N,) from those of its demonstrations (E,), or None where all are equal."""
    return None if np.ptp(weights) == 0 else weights[windows.episode]


def _indices(windows: Windows) -> Iterator[np.ndarray]:
    """Yield the places of all windows in their order, some at a time: together they take much more room than rows."""
    return (np.arange(start, min(start + BLOCK, len(windows))) for start in range(0, len(windows), BLOCK))


def _blocks(windows: Windows) -> Iterator[Batch]:
    return (windows[index] for index in _indices(windows))


def digest_of(windows: Windows, weights: np.ndarray | None = None, labels: Frames = NO_LABELS) -> str:
    """Return the SHA-256 of everything that a network can learn from ``windows`` of these weights and labels."""
    seal = hashlib.sha256()
    for field in Batch._fields:
        for batch in _blocks(windows):
            seal.update(np.ascontiguousarray(getattr(batch, field)).tobytes())
    if weights is not None:
        seal.update(np.ascontiguousarray(weights).tobytes())
    for frames in (frames for of in (windows.frames, labels) for of_camera in of.values() for frames in of_camera):
        seal.update(np.ascontiguousarray(frames))
    return seal.hexdigest()


def fit_interface(layout: Layout, windows: Windows, policy: PolicySettings) -> Interface:
    """Fit normalisers and switches of ``layout``: observations as related frames, anchored actions as offsets."""
    frames = Samples(lambda: (layout.relate(windows.present(index)) for index in _indices(windows)))
    targets = Samples(lambda: (to_offsets(layout, b.actions, b.obs)[~b.is_pad] for b in _blocks(windows)))
    action = Normaliser.fit(targets, policy.action_scaling, reach=layout.spec.action.reach)
    return Interface(layout, Normaliser.fit(frames), action, policy.obs_clip, Switches.fit(targets))


class TrainingSet:
    """Windows as normalised tensors, and the images that they show as they were recorded.

    Args:
        windows: where they are gathered from.
        interface: how they are normalised.
        device: where the tensors go.
        labels: what is to be told of their images; see :class:`Seen`.
        hold: whether beyond the end of an episode the last action is to be learned, where somebody said it.
    """

    def __init__(
        self,
        windows: Windows,
        interface: Interface,
        device: str = "cpu",
        labels: Frames = NO_LABELS,
        *,
        hold: bool = False,
    ) -> None:
        self._windows, self._interface, self._device, self._labels = windows, interface, device, labels
        self._hold = hold
        self._encoded = windows.mapped(interface.encode_obs, interface.action.normalise)
        self._moving = int(interface.layout.moving.sum())
        self._scaler = interface.action.first(self._moving).tiled(windows.chunk)
        self._moved = windows.mapped(interface.layout.origin_of, lambda actions: actions[:, : self._moving])

    def __len__(self) -> int:
        return len(self._windows)

    def gather(self, index: np.ndarray) -> tuple[Shown, Tensor, Tensor]:
        """Return what is shown (B, To, Do), actions (B, Ta, Da) and valid (B, Ta), 1 if to be learned, of ``index``."""
        inputs, targets, is_pad = self._encoded[index]
        if self._moving:  # what is counted from the window's own last frame cannot be encoded before
            origins, moving, _ = self._moved[index]
            counted = self._interface.layout.counted(moving, origins[:, -1:])
            scaled = self._scaler.normalise(counted.reshape(len(index), -1))
            targets[..., : self._moving] = scaled.reshape(counted.shape)
        known = ~is_pad
        if self._hold:
            over = self._windows.is_over(index)
            last = over.shape[1] - 1 - over.sum(1, keepdims=True)  # its action stands beyond the end, too
            known = known | (over & np.take_along_axis(known, last, 1))
        arrays = (inputs, targets, known.astype(np.float32))
        encoded, answers, valid = (tensor(array).to(self._device) for array in arrays)
        images, labels = (
            {name: torch.from_numpy(values).to(self._device) for name, values in gathered.items()}
            for gathered in (self._windows.images(index), self._windows.beside(self._labels, index))
        )
        return shown(encoded, images, labels), answers, valid

    def sample(self) -> np.ndarray:
        """Return the windows that a measurement looks at: all of them, or evenly spread ones where each has images."""
        count = min(len(self), IMAGES_AT_ONCE) if self.has_images else len(self)
        return np.linspace(0, len(self) - 1, count).round().astype(np.int64)

    @property
    def has_images(self) -> bool:
        """Whether gathering is slow enough to be done ahead."""
        return bool(self._windows.image_names)


class Shuffle:
    """The order in which steps are visited: a fresh permutation each epoch, a function of the seed alone.

    Args:
        size: number of windows.
        batch: windows in a minibatch.
        seed: decides the permutations.
        weights: (N,) how often each window is visited, relative to the others; None for all alike. An epoch still has
            ``size`` visits, drawn systematically: a window of twice the mean weight is visited twice, one of half of
            it in every other epoch.
    """

    def __init__(self, size: int, batch: int, *, seed: int, weights: np.ndarray | None = None) -> None:
        self.size, self.batch, self.seed = size, batch, seed
        self._reach = None if weights is None else _reach(weights)
        self._epoch, self._order = -1, np.zeros(0, np.int64)

    def __getitem__(self, step: int) -> np.ndarray:
        """Return the windows (B,) of optimisation step ``step``."""
        epochs, places = np.divmod(np.arange(step * self.batch, (step + 1) * self.batch), self.size)
        return np.concatenate([self._permutation(int(e))[places[epochs == e]] for e in np.unique(epochs)])

    def _permutation(self, epoch: int) -> np.ndarray:
        if epoch != self._epoch:
            self._epoch = epoch
            rng = named_rng(self.seed, "minibatches", str(epoch))
            self._order = rng.permutation(self.size if self._reach is None else _visits(self._reach, rng.random()))
        return self._order


def _reach(weights: np.ndarray) -> np.ndarray:
    """Return how many visits the windows up to each one (N,) have together, N in all."""
    reach = np.cumsum(weights / weights.mean())
    reach[-1] = len(weights)  # not a rounding error less
    return reach


def _visits(reach: np.ndarray, start: float) -> np.ndarray:
    """Return the windows (N,) visited in an epoch, each as its weight says, rounded up or down by ``start``."""
    return np.repeat(np.arange(len(reach)), np.diff(np.floor(reach + start).astype(int), prepend=0))


@dataclass(frozen=True, eq=False)
class Prepared:
    """What a run of supervised learning is given.

    Attributes:
        policy: what is trained. initial: whose weights it starts from, or None.
        interface: the way into and out of its network.
        training: windows to learn from. held_out: windows to validate on, or None.
        hidden: what is told of their images while it is trained, or None.
        order: in which they are visited.
        description: what of the data decides the run.
    """

    policy: PolicySettings
    initial: ChunkPolicy | None
    interface: Interface
    training: TrainingSet
    held_out: TrainingSet | None
    order: Shuffle
    description: dict[str, Any]
    hidden: Hidden | None = None


def hidden_in(demos: Demonstrations, auxiliary: float) -> Hidden | None:
    """Return what is told of images while a policy is trained, with the weight ``auxiliary``; None without one."""
    return Hidden.of(demos.layout, demos.kept, auxiliary) if auxiliary else None


def labels_in(demos: Demonstrations, hidden: Hidden | None) -> Frames:
    """Return what is to be told of the images of the demonstrations that are learned from."""
    return hidden.labels(demos.kept) if hidden else NO_LABELS


def prepare(
    demos: Demonstrations,
    policy: PolicySettings,
    *,
    batch_size: int,
    device: str,
    seed: int,
    initial: ChunkPolicy | None,
    auxiliary: float = 0.0,
) -> Prepared:
    """Cut demonstrations into windows and normalise them, as ``initial`` does where it is given.

    Args:
        auxiliary: weight of telling what is hidden from the policy; 0 for none of it.

    Raises:
        InvalidValueError: ``initial`` has another configuration than ``policy``, or there is nothing to tell.
    """
    layout = demos.layout
    if initial and (initial.config != policy or initial.interface.layout.names != layout.names):
        raise InvalidValueError("The initial policy has another configuration than the one to train.")
    windows = cut_windows(demos.kept, layout, policy)
    weights = window_weights(demos.weights, windows)
    interface = initial.interface if initial else fit_interface(layout, windows, policy)
    hidden = hidden_in(demos, auxiliary)
    labels = labels_in(demos, hidden)
    hold = policy.holds_its_end
    training = TrainingSet(windows, interface, device, labels, hold=hold)
    apart = cut_windows(demos.held_out, layout, policy) if demos.held_out else None
    held_out = TrainingSet(apart, interface, device, hold=hold) if apart else None
    order = Shuffle(len(training), batch_size, seed=seed, weights=weights)
    data = {
        "demonstrations": len(demos.kept) + len(demos.held_out),
        "frames": len(training),
        "digest": digest_of(windows, weights, labels),
    }
    start = {"initial": digest(Checkpoint(initial.to_checkpoint().arrays))} if initial else {}
    return Prepared(policy, initial, interface, training, held_out, order, {"dataset": data, **start}, hidden)
