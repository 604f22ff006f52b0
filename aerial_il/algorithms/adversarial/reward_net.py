"""A reward learned from demonstrations: its network, trained beside the agent, and its settings."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.adversarial.discriminator import (
    REWARDS,
    Discriminator,
    Reward,
    cross_entropy,
    gradient_penalty,
)
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.interface import encode, encode_actions
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer
from aerial_il.algorithms.run.folder import REWARD
from aerial_il.algorithms.run.state import Snapshot, load_weights, weights_of
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.checks import require_choice, require_not_negative, require_positive, require_share, require_widths
from aerial_il.core.errors import CheckpointError
from aerial_il.core.seeding import named_rng
from aerial_il.core.tensors import tensor
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork, unsquashed


class Shape(TypedDict):
    """What rebuilds the network; see :class:`Discriminator`. With ``actions`` false it sees observations alone."""

    hidden: Sequence[int]
    spectral: bool
    dropout: float
    running_norm: bool
    actions: bool
    form: Reward


@dataclass(frozen=True, kw_only=True)
class LearnedReward:
    """The discriminator, whose output is the reward.

    Attributes:
        form: of the reward, ``gail``, ``airl`` or ``exit``.
        hidden: widths of the discriminator.
        lr: its learning rate.
        updates: how often it learns.
        gradient_penalty: weight of that penalty; 0 for none.
        spectral_norm: normalise its matrices.
        dropout: of its inputs and hidden units.
        action_noise: give it demonstrated actions with the noise that the agent explores with. Else that noise is what
            it recognises the agent by, long before it sees where the agent errs.
    """

    form: Reward
    hidden: tuple[int, ...]
    lr: float
    updates: float
    gradient_penalty: float
    spectral_norm: bool
    dropout: float
    action_noise: bool

    def __post_init__(self) -> None:
        require_positive(self, "lr", "updates")
        require_share(self, "dropout", below_one=True)
        require_widths(self, "hidden")
        require_not_negative(self, "gradient_penalty")
        require_choice(self, "form", Reward)

    def shape(self, *, running_norm: bool, actions: bool = True) -> Shape:
        """Return of what form the discriminator is: whether it standardises its inputs itself, and sees actions."""
        return {
            "hidden": self.hidden,
            "spectral": self.spectral_norm,
            "dropout": self.dropout,
            "running_norm": running_norm,
            "actions": actions,
            "form": self.form,
        }


def starts_cloned(settings: Algorithm) -> bool:
    """Whether it starts with behavioural cloning, as the control without demonstrations does not."""
    return settings.bc_pretrain_steps > 0 and settings.demonstrations.control != "constant_reward"


class RewardNet:
    """A discriminator: its logits, the reward made of them, and its optimiser.

    Args:
        obs_size, action_size: Do and Da. shape: of the network and of the reward. lr: learning rate.
    """

    def __init__(self, obs_size: int, action_size: int, shape: Shape, *, lr: float = 3e-4) -> None:
        self.shape, self._sizes = shape, (obs_size, action_size)
        self.network = Discriminator(
            obs_size + 1 + action_size * shape["actions"],
            shape["hidden"],
            spectral=shape["spectral"],
            dropout=shape["dropout"],
            running_norm=shape["running_norm"],
        )
        self._trained: TrainState[nn.Module] = TrainState(self.network, adam(self.network, lr))

    @torch.no_grad()
    def reward(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return rewards (B,) for observations (B, Do + 1) and normalised actions (B, Da)."""
        return REWARDS[self.shape["form"]](self.network.eval()(self._inputs(obs, actions)))

    def logits(self, expert: Batch, agent: Batch) -> tuple[Tensor, Tensor]:
        """Return ``log D - log(1 - D)`` (B,) of the demonstrator's and of the agent's transitions, while training."""
        sides = self._sides(expert, agent)
        network, both = self.network.train(), torch.cat(sides)
        if network.norm is not None:
            network.norm.add(both)
        of_expert, of_agent = network(both).split([len(side) for side in sides])
        return of_expert, of_agent

    def gradient_penalty(self, expert: Batch, agent: Batch) -> Tensor:
        """Return how far the gradient norm is from 1 at random points between both sides' standardised inputs."""
        of_expert, of_agent = (self.network.standardised(side) for side in self._sides(expert, agent))
        return gradient_penalty(self.network.score, of_expert, of_agent, torch.rand(len(of_expert), 1))

    def descend(self, loss: Tensor) -> None:
        """Take one step against the gradient of ``loss``."""
        self._trained.descend(loss)

    def learn(
        self, demos: ReplayBuffer, flown: ReplayBuffer, count: int, actor: SquashedGaussianNetwork, how: LearnedReward
    ) -> dict[str, float]:
        """Take one step on ``count`` demonstrated and as many flown transitions; return named numbers.

        The loss is ``-log D`` of demonstrations ``- log(1 - D)`` of the agent's ``+ penalty (|grad| - 1)^2``.

        Args:
            actor: whose noise is put on demonstrated actions, if asked for. how: the settings.
        """
        shown = demos.sample(count)
        shown = with_action_noise(shown, actor) if how.action_noise else shown
        agent = flown.sample(count)
        loss, metrics = cross_entropy(*self.logits(shown, agent))
        if how.gradient_penalty:
            slope = self.gradient_penalty(shown, agent)
            loss, metrics = loss + how.gradient_penalty * slope, {**metrics, "reward/gradient_penalty": slope.item()}
        self.descend(loss)
        return metrics

    def along(self, episode: Episode, interface: Interface) -> np.ndarray:
        """Return the reward of each step of ``episode``, (T,)."""
        frames = interface.layout.flatten(episode.obs)[:-1]
        obs = np.pad(encode(interface, frames), ((0, 0), (0, 1)))
        actions = encode_actions(interface, episode.executed_actions, frames)
        return self.reward(tensor(obs), tensor(actions)).numpy()

    def after(self, ends: np.ndarray) -> np.ndarray:
        """Return the reward of each step in the absorbing states that ``ends`` (N, Do) lead to, (N,)."""
        marked = torch.cat([tensor(ends), torch.ones(len(ends), 1)], dim=1)
        return self.reward(marked, torch.zeros(len(ends), self._sizes[1])).numpy().astype(float)

    def save(self, run: str | os.PathLike[str]) -> Path:
        """Keep the reward in the folder of its run."""
        arrays = weights_of(self.network)
        sizes = {"obs_size": self._sizes[0], "action_size": self._sizes[1]}
        shape = {**self.shape, "hidden": list(self.shape["hidden"])}
        return checkpoint.save(Path(run) / REWARD, Checkpoint(arrays, {}, {**sizes, "shape": shape}))

    def snapshot(self) -> Snapshot:
        return self._trained.snapshot()

    def restore(self, saved: Snapshot) -> None:
        self._trained.restore(saved)

    def load(self, saved: Checkpoint) -> None:
        """Take over the weights that :meth:`save` kept."""
        load_weights(self.network, saved.arrays)

    def _sides(self, expert: Batch, agent: Batch) -> tuple[Tensor, Tensor]:
        return self._inputs(expert.obs, expert.actions), self._inputs(agent.obs, agent.actions)

    def _inputs(self, obs: Tensor, actions: Tensor) -> Tensor:
        return torch.cat([obs, actions], dim=-1) if self.shape["actions"] else obs


@torch.no_grad()
def with_action_noise(demos: Batch, actor: SquashedGaussianNetwork) -> Batch:
    """Return ``demos`` with the noise on their actions that ``actor`` would have added to them.

    What stands for the action in an absorbing state is none, and stays as it is.
    """
    _, log_std = actor.gaussian(demos.obs[:, None, :-1])
    raw, absorbing = unsquashed(demos.actions), demos.obs[:, -1:] > 0.0
    noisy = torch.tanh(raw + log_std.exp() * torch.randn_like(raw))
    return demos._replace(actions=torch.where(absorbing, demos.actions, noisy))


def load_reward(run: str | os.PathLike[str]) -> tuple[RewardNet, Interface]:
    """Return the reward that a finished run learned, and the way into it; see :meth:`RewardNet.along`.

    Raises:
        CheckpointError: the run has learned none, or what it kept is cut or altered.
    """
    reward = _kept(run)
    return reward, load_policy(run).interface


def reward_along(run: str | os.PathLike[str], episode: Episode) -> np.ndarray:
    """Return the reward learned by ``run`` for each step of ``episode``, (T,).

    Raises:
        CheckpointError: see :func:`load_reward`.
        InvalidValueError: the episode comes from another environment than the run.
    """
    reward, policy = _kept(run), load_policy(run)
    policy.check(episode.spec)
    return reward.along(episode, policy.interface)


def _kept(run: str | os.PathLike[str]) -> RewardNet:
    folder = Path(run) / REWARD
    if not checkpoint.is_sealed(folder):
        hint = "Only finished runs of gail, dac and airl keep one."
        raise CheckpointError(folder, "holds no learned reward.", hint)
    saved = checkpoint.load(folder)
    try:
        sizes = saved.config["obs_size"], saved.config["action_size"], saved.config["shape"]
        reward = built_for(saved.arrays, lambda: RewardNet(*sizes))
        reward.load(saved)
    except (LookupError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise CheckpointError(folder, f"is no reward that this release can rebuild ({error}).") from error
    return reward


def shuffled(episode: Episode) -> Episode:
    """Return ``episode`` with its actions in another order, for which a learned reward should be lower."""
    order = named_rng(0, "shuffled actions").permutation(len(episode))
    return replace(episode, executed_actions=episode.executed_actions[order])
