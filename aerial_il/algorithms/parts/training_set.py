"""Demonstrations as a network wants them: checked, split, normalised, in minibatches of tensors."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.errors import InvalidValueError, NonFiniteActionError
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.data.windows import Windows
from aerial_il.policies.parts.layout import Interface, Layout, to_offsets
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches

VALIDATE = "Find out more: aerial-il validate PATH"


def read_demos(
    dataset: Iterable[Episode], policy: PolicyConfig, *, failures: bool = False
) -> tuple[Layout, list[Episode]]:
    """Return the successful episodes, or all of them, and the layout ``policy`` sees them in.

    Whatever nothing should learn from is refused.

    Raises:
        InvalidValueError: there is no success, episodes come from different environments, one is shorter than the
            policy's chunk, or a value is not finite.
        UnknownNameError: the episodes lack an observation field.
    """
    demos = [episode for episode in dataset if episode.success or failures]
    if not demos:
        hint = "Record some: aerial-il collect robot=R task=T episodes=100 out=datasets/NAME"
        raise InvalidValueError(f"The dataset holds no successful demonstration. {hint}")
    layout = Layout.of(demos[0].spec, policy)
    for episode in demos:
        _check(episode, layout, policy.chunk)
    return layout, demos


def _check(episode: Episode, layout: Layout, chunk: int) -> None:
    if differing := layout.spec.differences(episode.spec):
        raise InvalidValueError(f"Episode {episode.uid} comes from another environment: {'; '.join(differing)}.")
    if len(episode) < chunk:
        raise InvalidValueError(f"Episode {episode.uid} has {len(episode)} steps; chunk={chunk} must not be longer.")
    try:
        layout.flatten(episode.obs)
    except NonFiniteActionError as error:
        where = f"at step {min(error.worlds)}"  # the leading axis of one episode is time
        raise InvalidValueError(f"Episode {episode.uid}: {error.what} is not finite {where}. {VALIDATE}") from error
    finite = np.isfinite(episode.executed_actions).all(1)
    if not finite.all():
        where = f"at step {int(np.argmin(finite))}"
        raise InvalidValueError(f"Episode {episode.uid}: the action is not finite {where}. {VALIDATE}")


def split(demos: Sequence[Episode], fraction: float, *, seed: int) -> tuple[list[Episode], list[Episode]]:
    """Draw ``fraction`` of the demonstrations, at least one where there are two, for validation.

    Returns:
        Those to train on and those to validate on, each in their order.
    """
    count = min(len(demos) - 1, max(1, round(fraction * len(demos)))) if fraction > 0 else 0
    held = set(named_rng(seed, "validation split").permutation(len(demos))[:count].tolist())
    return [d for i, d in enumerate(demos) if i not in held], [d for i, d in enumerate(demos) if i in held]


def cut_windows(demos: Sequence[Episode], layout: Layout, policy: PolicyConfig) -> Windows:
    """Cut ``demos`` into windows, labelled by the expert where it was asked, else by what was flown."""
    history, chunk = policy.history, policy.chunk
    return Windows(demos, layout.names, history=history, chunk=chunk, target="expert_actions", successes_only=False)


def digest_of(windows: Windows) -> str:
    """Return the SHA-256 of everything that a network can learn from ``windows``."""
    seal = hashlib.sha256()
    for array in windows[np.arange(len(windows))]:
        seal.update(np.ascontiguousarray(array).tobytes())
    return seal.hexdigest()


def fit_interface(layout: Layout, windows: Windows, policy: PolicyConfig) -> Interface:
    """Fit normalisers and switches of ``layout``: observations as related frames, anchored actions as offsets."""
    obs, actions, is_pad = windows[np.arange(len(windows))]
    frames = layout.relate(obs[:, -1])
    targets = to_offsets(layout, actions, obs)[~is_pad]
    action = Normaliser.fit(targets, policy.action_scaling)
    return Interface(layout, Normaliser.fit(frames), action, policy.obs_clip, Switches.fit(targets))


class TrainingSet:
    """Windows as normalised tensors.

    Args:
        windows: where they are gathered from.
        interface: how they are normalised.
        device: where the tensors go.
    """

    def __init__(self, windows: Windows, interface: Interface, device: str = "cpu") -> None:
        self._windows, self._interface, self._device = windows, interface, device

    def __len__(self) -> int:
        return len(self._windows)

    def gather(self, index: np.ndarray) -> tuple[Tensor, Tensor, Tensor]:
        """Return obs (B, To, Do), actions (B, Ta, Da) and valid (B, Ta), 1 within the episode, at ``index`` (B,)."""
        obs, actions, is_pad = self._windows[index]
        inputs, targets = self._interface.encode_obs(obs), self._interface.encode_actions(actions, obs)
        arrays = (inputs, targets, (~is_pad).astype(np.float32))
        encoded, answers, valid = (torch.from_numpy(array).to(self._device) for array in arrays)
        return encoded, answers, valid


class Shuffle:
    """The order in which steps are visited: a fresh permutation each epoch, a function of the seed alone.

    Args:
        size: number of windows.
        batch: windows in a minibatch.
        seed: decides the permutations.
    """

    def __init__(self, size: int, batch: int, *, seed: int) -> None:
        self.size, self.batch, self.seed = size, batch, seed
        self._epoch, self._order = -1, np.zeros(0, np.int64)

    def __getitem__(self, step: int) -> np.ndarray:
        """Return the windows (B,) of optimisation step ``step``."""
        epochs, places = np.divmod(np.arange(step * self.batch, (step + 1) * self.batch), self.size)
        return np.concatenate([self._permutation(int(e))[places[epochs == e]] for e in np.unique(epochs)])

    def _permutation(self, epoch: int) -> np.ndarray:
        if epoch != self._epoch:
            self._epoch = epoch
            self._order = named_rng(self.seed, "minibatches", str(epoch)).permutation(self.size)
        return self._order
