"""Imitation bootstrapped reinforcement learning (IBRL): a prior proposes beside the actor, and critics choose.

The prior is a policy of any class (``prior=RUN``), chunked ones too, or a clone of the demonstrations; it never
changes. In flight, and in what the critics learn,

    ``Q(s, a) = r + gamma * (min over Z of Q'(s', a'))``,    a' the better of the prior's and the actor's action in s',

the better action is taken: learning starts from the value of the prior, and leaves it where a higher one is estimated.
Better is the actor's own action whose value exceeds the prior's, on average over the ensemble, by ``caution`` standard
deviations of that difference over the critics; the source compares the minimum of two critics, which is near to no
caution, and with little caution a prior of 67 % fell here to 6.5 %. The actor ascends the mean of
the critics, as in TD3 with noise on its actions and on the target's, and is held near the prior's action b: it descends

    ``-mean Q(s, mu(s)) + prior_weight * mean |Q| * |mu(s) - b|^2 / Da``,

for critics have seen nothing but what the prior does, and far from it they agree by mistake. Up to ``warmup`` the prior
flies alone, critics learn its value, and the actor what to propose.

What is evaluated and saved is what flies: the prior up to ``warmup``, then actor, prior and critics in one policy.

Metrics: ``critic/loss``, ``critic/value``, ``critic/spread``, ``critic/own`` (share of decisions for the actor in what
critics learn), ``actor/loss``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring policy;
``evaluate/<name>``; ``elapsed_s``.

Source: H. Hu, S. Mirchandani, D. Sadigh, "Imitation Bootstrapped Reinforcement Learning", 2023, algorithm 1. Ours are
the caution, the pull towards the prior (as S. Fujimoto, S. Gu, "A Minimalist Approach to Offline Reinforcement
Learning", 2021, equation 5, pull towards a dataset), half demonstrations in each minibatch (from RLPD), and that a
prior's action in a demonstrated state is what was demonstrated there.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.off_policy.agent import Agent, squared_error
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.off_policy.problems import check_warmup
from aerial_il.algorithms.off_policy.proposals import Proposals, ProposedFlights, proposed_demos
from aerial_il.algorithms.off_policy.settings import Critics, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem, Source, from_demonstrations
from aerial_il.algorithms.online.replay_buffer import Batch, bc_pretrain, mixed
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.algorithms.run.train_state import Follower, TrainState, adam
from aerial_il.core.checkpoint import digest
from aerial_il.core.checks import require_not_negative
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.gated import GatedPolicy, prefers_own
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class IBRL(Algorithm):
    """Imitation bootstrapped reinforcement learning (Hu et al. 2023, algorithm 1).

    Attributes:
        warmup: the first of those steps, flown by the prior alone, while critics learn its value and the actor what to
            propose.
        prior: a run or policy of any class; null for a clone of the demonstrations by a network like the actor's.
        bc_pretrain_steps: minibatches of which that clone is made.
        caution: standard deviations over the critics by which the actor's action must be better than the prior's.
        prior_weight: of the actor's mean squared distance from the prior's action, in units of the mean value; 0 to let
            it go wherever critics expect more.
    """

    name: ClassVar[str] = "ibrl"
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 2
    prior: str | None = None
    bc_pretrain_steps: int = 5_000
    caution: float = 4.0
    prior_weight: float = 10.0
    subset: int = 2
    noise: float = 0.1
    target_noise: float = 0.2
    noise_clip: float = 0.5
    demos_share: float = 0.5
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=2.0)
    critics: Critics = Critics(count=5, hidden=(256, 256), layer_norm=True, tau=0.005)
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    failures: bool = False
    reward: Source = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "caution", "prior_weight")

    def problem(self, given: Given) -> Problem:
        """Read the demonstrations, and refuse a prior that cannot fly here."""
        check_warmup(self, given.env)
        inputs = {"prior": digest(load_prior(self.prior, given.env.spec).to_checkpoint())} if self.prior else {}
        return replace(from_demonstrations(self, given), inputs=inputs)

    def learn(self, run: OnlineRun) -> None:
        absorbing, size = self.demonstrations.absorbing, self.replay.batch_size
        cloned = TrainState(actor := run.build_actor(SquashedGaussianNetwork), adam(actor, self.lr))
        if not (self.prior or run.folder.resumed):
            plain = run.demos.buffer(run.interface, run.rng("prior"), absorbing=absorbing)
            bc_pretrain(cloned, actor, plain, steps=self.bc_pretrain_steps, batch_size=size)
        prior = load_prior(self.prior, run.collector.env.spec) if self.prior else run.policy_of(actor)
        agent = ProposedAgent(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        proposals = Proposals(prior.fresh(), run.collector, run.interface)
        demos = proposed_demos(run.demos, run.interface, run.rng("demonstrations"), absorbing=absorbing)
        flights = ProposedFlights(run, self.replay.capacity, proposals, warmup=self.warmup, absorbing=absorbing)
        run.wrap = lambda own: (
            GatedPolicy(own, prior.fresh(), agent.targets.network, hidden=self.critics.hidden, caution=self.caution)
            if run.collector.steps > self.warmup
            else prior.fresh()
        )

        def update(improve: bool) -> dict[str, float]:
            return agent.update(mixed(demos, flights.buffer, size, self.demos_share), listen=improve)

        learn_off_policy(run, self, agent, flights, update, parts={"clone": cloned, "demonstrations": demos})


class ProposedAgent(Agent[SquashedGaussianNetwork]):
    """Actor and an ensemble of critics, with slowly following target networks of both.

    Its observations carry the prior's proposal, (B, Do + Da + 1 + 1), see
    :mod:`aerial_il.algorithms.off_policy.proposals`.
    """

    changing = (*Agent.changing, "actor_target")

    def __init__(self, settings: IBRL, actor: SquashedGaussianNetwork, sizes: tuple[int, int]) -> None:
        super().__init__(settings, actor, sizes)
        self.actor_target = Follower(actor)

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return the better actions (n, Da) of the prior's, and of the actor's with noise, for (n, Do + Da + 1)."""
        seen, other, _ = tensor(obs).split([*self.sizes, 1], dim=1)
        own = self.actor(seen[:, None])[:, 0]
        own = (own + self.settings.noise * torch.randn_like(own)).clamp(-1, 1)
        marked = torch.cat([seen, torch.zeros(len(seen), 1)], dim=1)
        chosen = prefers_own(self.targets.network, marked, own, other, caution=self.settings.caution)
        return torch.where(chosen[:, None], own, other).numpy()

    def update(self, batch: Batch, *, listen: bool = True) -> dict[str, float]:
        """Take one step of the critics and, where it is due, of the actor and all targets.

        Args:
            batch: with proposals. listen: whether the actor may be chosen; else critics learn the value of the prior
                alone, but for the step after a cut, where there is no proposal and the actor stands in for it.
        """
        loss, metrics = self.critic_loss(batch, listen=listen)
        self.critics.descend(loss)
        self.targets.follow(self.settings.critics.tau)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            loss = self.actor_loss(batch)
            self.actor_state.descend(loss)
            self.actor_target.follow(self.settings.critics.tau)
            metrics["actor/loss"] = loss.item()
        return metrics

    def critic_loss(self, batch: Batch, *, listen: bool = True) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error, summed over the critics."""
        targets, own = self.bellman_targets(batch, listen=listen)
        seen = batch._replace(obs=self._apart(batch.obs)[0])
        loss, metrics = squared_error(self.critics.network, seen, targets, spread=True)
        return loss, {**metrics, "critic/own": own}

    @torch.no_grad()
    def bellman_targets(self, batch: Batch, *, listen: bool) -> tuple[Tensor, float]:
        """Return ``r + gamma * (min over Z of Q'(s', a'))`` (B,), and how often a' was the actor's."""
        obs, proposed, known = self._apart(batch.next_obs)
        own = self.actor_target.network(obs[:, None, :-1])[:, 0]
        limit = self.settings.noise_clip
        noise = (self.settings.target_noise * torch.randn_like(own)).clamp(-limit, limit)
        own = (own + noise).clamp(-1, 1)
        better = prefers_own(self.targets.network, obs, own, proposed, caution=self.settings.caution) & listen
        taken = torch.where((better | ~known)[:, None], own, proposed) * (1.0 - obs[:, -1:])
        drawn = torch.randperm(self.settings.critics.count)[: self.settings.subset]
        values = self.targets.network(obs, taken, drawn).min(0).values
        return batch.rewards + self.settings.gamma * batch.continues * values, better.float().mean().item()

    def actor_loss(self, batch: Batch) -> Tensor:
        """Return what the actor descends, see the module, without the absorbing state, plus the smoothness loss."""
        (obs, proposed, known), (next_obs, _, _) = self._apart(batch.obs), self._apart(batch.next_obs)
        alive = 1.0 - obs[:, -1]
        own = self.actor(obs[:, None, :-1])[:, 0]
        values = self.critics.network(obs, own).mean(0)
        apart = ((own - proposed) ** 2).mean(1) * known
        held = self.settings.prior_weight * values.detach().abs().mean() * apart
        smooth = self.settings.smoothness.loss(self.actor, obs[:, :-1], next_obs[:, :-1])
        return (alive * (held - values)).sum() / alive.sum().clamp(min=1.0) + smooth

    def _apart(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return observations with their mark (B, Do + 1), proposals (B, Da), and where there is one (B,) bool."""
        seen, proposed, known, mark = obs.split([*self.sizes, 1, 1], dim=1)
        return torch.cat([seen, mark], dim=1), proposed, known[:, 0] > 0.5
