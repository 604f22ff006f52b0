"""A prior of any class proposes beside the actor, and is left only where critics are sure."""

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.ibrl import ProposedAgent
from aerial_il.algorithms.off_policy.proposals import demonstrated_rows
from aerial_il.algorithms.online.demonstrations import read_transitions
from aerial_il.algorithms.online.interface import encode_actions, plain_interface
from aerial_il.algorithms.online.replay_buffer import Batch, split
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.gated import GatedPolicy
from aerial_il.policies.parts.layout import Layout
from tests.algorithms import small
from tests.algorithms.drift import SPEC, Drift, demonstrations, mean_reward
from tests.algorithms.small import POLICY, short
from tests.algorithms.stopped import assert_same_when_stopped, bytes_of

CHUNKED = MLP(hidden=(16,), chunk=3, execute=3, ensemble=None, anchor=None, masked_fields=())
BRIEF: dict[str, Any] = {"steps": 320, "critics": 3, "bc_pretrain_steps": 50}


def train(run: Path, *, evaluate: Any = None, env: Any = None, **changes: Any) -> Any:
    settings = short("ibrl", **{**BRIEF, **changes})
    return small.train(settings, run, env or Drift(8), demonstrations(6), evaluate=evaluate)


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone of another class that acts in chunks of three steps."""
    run = tmp_path_factory.mktemp("prior") / "run"
    cloning = BC(steps=300, batch_size=64, lr=3e-3, warmup_steps=10, ema=0.9, validation=0.0)
    cloning.train(demonstrations(40), CHUNKED, run=run, progress=False)
    return run


def test_what_is_saved_flies_as_what_was_trained(tmp_path: Path, prior: Path) -> None:
    """Actor, chunked prior and critics, over a whole episode."""
    trained, again = train(tmp_path, prior=str(prior), caution=0.0), load_policy(tmp_path)
    assert isinstance(again, GatedPolicy)
    assert again.prior.config == CHUNKED
    env, taken = Drift(20), []
    obs = env.reset(0)
    trained.reset()
    for _ in range(8):
        own, proposed = again.network, again.prior
        assert own is not None
        assert proposed is not None
        actions = trained.act(obs)
        np.testing.assert_array_equal(actions, again.act(obs))
        taken.append(actions)
        obs = env.step(actions).obs
    led = load_policy(prior).act(Drift(20).reset(0))
    followed = np.isclose(taken[0], led).all(axis=1)
    assert 0 < followed.sum() < 20, "in some worlds the prior is followed, in others it is not"


def test_stopped_within_a_chunk_it_ends_with_the_same_bytes(tmp_path: Path, prior: Path) -> None:
    settings = {"prior": str(prior), "evaluate_every": 40, "checkpoint_every": 40}
    assert_same_when_stopped(partial(train, **settings), tmp_path, 120, 200)


def test_evaluation_leaves_the_prior_that_flies_alone(tmp_path: Path, prior: Path) -> None:
    """Judging flies the same prior in other worlds, with a memory of its own."""

    def judged(policy: Any, step: int) -> dict[str, float]:
        policy.reset()
        policy.act(Drift(5).reset(3))
        return {}

    settings = {"prior": str(prior), "evaluate_every": 40}
    for name, evaluate in (("judged", judged), ("alone", None)):
        train(tmp_path / name, evaluate=evaluate, **settings)
    assert bytes_of(tmp_path / "judged") == bytes_of(tmp_path / "alone")


def test_a_prior_that_acts_otherwise_or_is_missing_is_refused(tmp_path: Path, prior: Path) -> None:
    with pytest.raises(CheckpointError, match="does not exist"):
        train(tmp_path / "run", prior=str(tmp_path / "nowhere"))
    seen = SPEC.observation.fields[0]
    env = Drift(8)
    env.spec = replace(
        SPEC, observation=replace(SPEC.observation, fields=(replace(seen, unit="km"), *SPEC.observation.fields[1:]))
    )
    with pytest.raises(InvalidValueError, match=r"cannot fly here.*prior=RUN"):
        train(tmp_path / "other", prior=str(prior), env=env)
    assert not (tmp_path / "run" / "checkpoints").exists()


def test_another_prior_in_the_same_place_is_another_run(tmp_path: Path, prior: Path) -> None:
    here = tmp_path / "prior"
    shutil.copytree(prior, here)
    train(tmp_path / "run", prior=str(here))
    shutil.rmtree(here)
    cloning = BC(steps=20, batch_size=64, warmup_steps=10, ema=0.9, validation=0.0)
    cloning.train(demonstrations(4), CHUNKED, run=here, progress=False)
    with pytest.raises(InvalidValueError, match=r"holds another run.*prior"):
        train(tmp_path / "run", prior=str(here))


def test_until_the_warm_up_ends_the_prior_flies_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    explore = ProposedAgent.explore

    def counted(self: ProposedAgent, obs: np.ndarray) -> np.ndarray:
        asked.append(len(obs))
        return explore(self, obs)

    monkeypatch.setattr(ProposedAgent, "explore", counted)
    train(tmp_path, steps=160, log_every=32)
    assert sum(asked) == 160 - 64
    rows = read_metrics(tmp_path)
    assert rows[0]["critic/own"] == 0.0
    assert rows[-1]["critic/own"] > 0.0
    assert "actor/loss" in rows[0], "the actor learns what to propose"


def test_what_is_evaluated_is_what_flies(tmp_path: Path, prior: Path) -> None:
    """The prior until the warm-up ends."""
    judged: dict[int, Any] = {}

    def evaluate(policy: Any, step: int) -> dict[str, float]:
        judged[step] = policy
        return {}

    train(tmp_path, prior=str(prior), evaluate=evaluate, evaluate_every=32)
    gated = {step for step, policy in judged.items() if isinstance(policy, GatedPolicy)}
    assert gated == {step for step in judged if step > 64}
    assert mean_reward(judged[64]) == pytest.approx(mean_reward(load_policy(prior)), abs=1e-6)


def test_it_keeps_what_its_prior_could(tmp_path: Path, prior: Path) -> None:
    """With a caution that nothing overcomes it is the prior; with the default one no worse."""
    alone = mean_reward(load_policy(prior))
    bound = train(tmp_path / "bound", prior=str(prior), caution=1e6)
    assert mean_reward(bound) == pytest.approx(alone, abs=1e-6)
    learned = train(tmp_path / "learned", prior=str(prior), steps=1_200)
    assert mean_reward(learned) > alone - 0.01


# -- its parts


def agent(**changes: Any) -> ProposedAgent:
    torch.manual_seed(0)
    return ProposedAgent(short("ibrl", **{**BRIEF, **changes}), POLICY.build(2, 1), (2, 1))


def batch(size: int = 64, *, known: float = 1.0) -> Batch:
    """Observations, proposals, whether there are any, and the mark of the absorbing state."""
    torch.manual_seed(1)

    def seen() -> torch.Tensor:
        marks = torch.zeros(size, 1)
        return torch.cat([torch.randn(size, 2), torch.rand(size, 1) * 2 - 1, marks + known, marks], 1)

    return Batch(seen(), torch.rand(size, 1) * 2 - 1, seen(), torch.randn(size), torch.ones(size))


def test_backups_take_the_better_of_two_actions() -> None:
    settings = {"caution": 0.0, "target_noise": 0.0, "subset": 3}
    one, seen = agent(**settings), batch()
    targets, share = one.bellman_targets(seen, listen=True)
    obs = torch.cat([seen.next_obs[:, :2], seen.next_obs[:, -1:]], 1)
    own = one.actor_target.network(obs[:, None, :2])[:, 0]
    values = torch.stack([one.targets.network(obs, a).mean(0) for a in (own, seen.next_obs[:, 2:3])])
    least = torch.stack([one.targets.network(obs, a).min(0).values for a in (own, seen.next_obs[:, 2:3])])
    wanted = seen.rewards + 0.9 * least.gather(0, values.argmax(0, keepdim=True))[0]
    assert torch.allclose(targets, wanted, atol=1e-5)
    assert 0 < share < 1, "each is the better one at times"


def test_more_caution_leaves_the_prior_more_rarely() -> None:
    shares = [agent(caution=caution).bellman_targets(batch(), listen=True)[1] for caution in (0.0, 1.0, 3.0)]
    assert shares[0] > shares[1] >= shares[2]
    assert agent(caution=0.0).bellman_targets(batch(), listen=False)[1] == 0.0


def test_where_there_is_no_proposal_the_actor_alone_is_asked() -> None:
    one, seen = agent(caution=1e6, target_noise=0.0, subset=3), batch(known=0.0)
    obs = torch.cat([seen.next_obs[:, :2], seen.next_obs[:, -1:]], 1)
    values = one.targets.network(obs, one.actor_target.network(obs[:, None, :2])[:, 0]).min(0).values
    assert torch.allclose(one.bellman_targets(seen, listen=True)[0], seen.rewards + 0.9 * values, atol=1e-5)


@pytest.mark.parametrize("known", [0.0, 1.0])
def test_the_actor_is_held_near_the_proposal(known: float) -> None:
    one, seen = agent(prior_weight=3.0), batch(known=known)
    obs = torch.cat([seen.obs[:, :2], seen.obs[:, -1:]], 1)
    own = one.actor(obs[:, None, :2])[:, 0]
    values = one.critics.network(obs, own).mean(0)
    wanted = -values.mean() + 3.0 * known * values.abs().mean() * ((own - seen.obs[:, 2:3]) ** 2).mean()
    assert one.actor_loss(seen).item() == pytest.approx(wanted.item(), rel=1e-5)


def test_what_follows_in_a_demonstration_is_what_is_proposed() -> None:
    demos = demonstrations(3)
    _, transitions, _ = read_transitions(demos, POLICY, trajectories=None, subsample=1, seed=0)
    interface = plain_interface(Layout.of(SPEC, POLICY), POLICY)
    rows = demonstrated_rows(transitions, interface, absorbing=False)
    result = split(torch.from_numpy(rows), (5, 1, 5, 1, 1))
    ends = np.cumsum([len(demo) for demo in demos]) - 1
    known = result.next_obs[:, 3].numpy() > 0.5
    assert not known[ends].any()
    assert known.sum() == len(rows) - 3
    np.testing.assert_array_equal(
        result.next_obs[:-1, 2].numpy()[known[:-1]], result.actions[1:, 0].numpy()[known[:-1]]
    )
    shown = encode_actions(interface, transitions.actions, transitions.frames)
    np.testing.assert_allclose(result.obs[:, 2:3].numpy(), shown, atol=1e-6)
