"""Who flies and who is asked in interactive learning: gates, mixtures, supervisors and noise."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aerial_il
from aerial_il.algorithms.dart import Disturbed, Noise
from aerial_il.algorithms.interactive.costs import FlightCosts
from aerial_il.algorithms.interactive.disagreement import ActionScale, disagreement
from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.interactive.gates.gate import Round
from aerial_il.algorithms.interactive.gates.human import Corrector, HumanGate
from aerial_il.algorithms.interactive.gates.thrifty import Thresholds, ThriftyGate, _Thrifty
from aerial_il.algorithms.interactive.mixture import IGNORED_STEPS, Decision, GateInput, Mixture, newcomer_of
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.contracts import attach
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from tests.algorithms.corridor import Corridor
from tests.algorithms.train_rounds import BC, DAGGER, DART, POLICY, THRIFTY, demonstrations, flights_of, train


@pytest.fixture(scope="module")
def demos(tmp_path_factory: pytest.TempPathFactory) -> list[Episode]:
    return demonstrations(tmp_path_factory.mktemp("demos"))


@given(
    beta=st.sampled_from(["exponential", "linear", "zero"]),
    decay=st.floats(0, 1),
    over=st.integers(1, 30),
    number=st.integers(0, 40),
)
@settings(max_examples=60, deadline=None)
def test_a_beta_schedule_begins_with_the_expert_and_never_rises(
    beta: Any, decay: float, over: int, number: int
) -> None:
    gate = CoinGate(beta=beta, decay=decay, over=over)
    assert gate.share(0) == 1.0
    assert 0.0 <= gate.share(number + 1) <= gate.share(number) <= 1.0


def test_named_schedules_are_what_their_names_say() -> None:
    assert [CoinGate(decay=0.5).share(i) for i in (1, 3)] == [0.5, 0.125]
    assert [CoinGate(beta="linear", over=4).share(i) for i in (1, 3, 4, 9)] == [0.75, 0.25, 0.0, 0.0]
    assert [CoinGate(beta="zero").share(i) for i in (0, 1)] == [1.0, 0.0]


def coins(seeds: np.ndarray, steps: int = 200, hold: int = 1) -> np.ndarray:
    gate = CoinGate(beta="exponential", decay=0.3, hold=hold).open(Round(1, 7, [], [], []))
    gate.begin(seeds, np.ones(len(seeds), bool))
    sight = GateInput({}, *np.zeros((2, len(seeds), 1)), np.zeros(len(seeds), bool))
    return np.stack([gate.decide(sight).expert_flies for _ in range(steps)], axis=1)


def test_coins_fall_by_the_episode_not_by_its_place_in_the_batch() -> None:
    together = coins(np.array([5, 6, 7]))
    np.testing.assert_array_equal(coins(np.array([7]))[0], together[2])
    assert not np.array_equal(together[0], together[1])
    assert 0.2 < coins(np.arange(10)).mean() < 0.4


def test_whoever_wins_a_toss_flies_for_a_while() -> None:
    held = coins(np.arange(40), steps=60, hold=20)
    np.testing.assert_array_equal(held, np.repeat(coins(np.arange(40), steps=3), 20, axis=1))
    assert held.any(axis=0).all(), "somebody's coin falls for the expert in each stretch"
    gate = CoinGate(decay=0.5, hold=20).open(Round(1, 7, [], [], []))
    sight = GateInput({}, *np.zeros((2, 40, 1)), np.zeros(40, bool))
    gate.begin(np.arange(40), np.ones(40, bool))
    before = [gate.decide(sight).expert_flies for _ in range(7)][-1]
    gate.begin(np.arange(100, 140), np.arange(40) < 20)
    after = gate.decide(sight).expert_flies
    np.testing.assert_array_equal(after[20:], before[20:])
    assert (after[:20] != before[:20]).any(), "a new episode tosses anew"


class Fixed:
    """Does what it is told and counts."""

    def __init__(self, value: float) -> None:
        self.value = value

    def reset(self, mask: np.ndarray | None = None) -> None: ...

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        return np.full((len(obs["error"]), 1), self.value)


class Every:
    """Lets the expert fly where the mask says so, and asks elsewhere where the second says so."""

    def __init__(self, flies: list[bool], asks: list[bool]) -> None:
        self.choice = Decision(np.array(flies), np.array(asks))

    def begin(self, seeds: np.ndarray, mask: np.ndarray) -> None: ...

    def decide(self, sight: GateInput) -> Decision:
        return self.choice


def test_a_mixture_flies_and_tells_what_the_gate_says() -> None:
    mixture = Mixture(Fixed(0.1), Fixed(0.2), Every([True, False, False], [False, True, False]))
    mixture.attach(Corridor(3))
    assert mixture.act({"error": np.zeros((3, 1))})[:, 0].tolist() == [0.2, 0.1, 0.1]
    np.testing.assert_array_equal(mixture.expert_action[:, 0], [0.2, 0.2, np.nan])
    assert mixture.is_intervention.tolist() == [True, False, False]
    mixture.reset(np.array([True, False, False]))
    assert not mixture.is_intervention.any()


class Stubborn(Fixed):
    """Wants 9 until it is told to forget, in that world, and 0 from then on."""

    def attach(self, env: Any) -> None:
        self.wishes = np.full((env.num_envs, 1), 9.0)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.wishes[slice(None) if mask is None else mask] = 0.0

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        return self.wishes.copy()


def test_an_expert_that_is_ignored_for_long_looks_again() -> None:
    """Where it flies itself it is not ignored, however far the learner's action is."""
    gate = Every([False, True], [True, True])
    mixture = Mixture(Fixed(0.0), Stubborn(0.0), gate, ActionScale(np.ones(1)))
    mixture.attach(Corridor(2))
    for _ in range(IGNORED_STEPS):
        mixture.act({"error": np.zeros((2, 1))})
        assert (mixture.expert_action == 9.0).all()
    mixture.act({"error": np.zeros((2, 1))})
    assert mixture.expert_action[:, 0].tolist() == [0.0, 9.0]


class Counting(Stubborn):
    """Wants as much as it remembers steps: what no policy can see."""

    def attach(self, env: Any) -> None:
        self.wishes = np.zeros((env.num_envs, 1))

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        self.wishes = self.wishes + 1.0
        return self.wishes.copy()


def test_advice_from_memory_is_no_label_unless_the_expert_flies() -> None:
    gate = Every([False, True], [True, True])
    mixture = Mixture(Fixed(0.0), Counting(0.0), gate, ActionScale(np.ones(1)), newcomer=Counting(0.0))
    mixture.attach(Corridor(2))
    seen = {"error": np.zeros((2, 1))}
    mixture.act(seen)
    assert mixture.expert_action[:, 0].tolist() == [1.0, 1.0], "in its first step it knows no more than a newcomer"
    mixture.act(seen)
    np.testing.assert_array_equal(mixture.expert_action[:, 0], [np.nan, 2.0])
    mixture.reset(np.array([True, False]))
    mixture.act(seen)
    assert mixture.expert_action[:, 0].tolist() == [1.0, 3.0]


def test_a_newcomer_disturbs_neither_the_expert_nor_its_noise() -> None:
    """It shares nothing with the expert that either of them writes."""
    expert = aerial_il.expert("fa_hexa_arm4", "pick_place", noise=1.0)
    env = aerial_il.load_batch("fa_hexa_arm4", "pick_place", num_envs=2, num_threads=1)
    obs = env.reset(0)
    alone, watched = [], []
    for actions, beside in ((alone, False), (watched, True)):
        newcomer = newcomer_of(expert) if beside else None
        for policy in filter(None, (expert, newcomer)):
            attach(policy, env)
        for _ in range(5):
            actions.append(expert.act(obs))
            if newcomer is not None:
                newcomer.reset()
                newcomer.act(obs)
    env.close()
    np.testing.assert_array_equal(alone, watched)
    assert newcomer_of(Fixed(0.0)) is None, "who has no phases remembers none"


def thrifty(others: list[Any], **options: Any) -> _Thrifty:
    limits = Thresholds(novelty=0.1, risk=np.inf, discrepancy=0.3, calm=np.inf)
    gate = _Thrifty(others, ActionScale(np.ones(1)), None, limits, **({"least": 2, "patience": 1} | options))
    gate.begin(np.arange(1), np.ones(1, bool))
    return gate


def fly(gate: _Thrifty, proposals: list[float], wishes: list[float]) -> list[bool]:
    flew, told = np.zeros(1, bool), []
    for proposed, wished in zip(proposals, wishes, strict=True):
        sight = GateInput({"error": np.zeros((1, 1))}, np.array([[proposed]]), np.array([[wished]]), flew)
        flew = gate.decide(sight).expert_flies
        told.append(bool(flew[0]))
    return told


def test_doubt_calls_the_expert_and_agreement_sends_it_away() -> None:
    """The other member says 0: the variance is a quarter of the square, so 1 is alarming and 0.5 is not."""
    proposals, wishes = [0.5, 1.0, 0.5, 0.5, 0.5, 0.5], [0.5, 0.0, 0.0, 0.4, 0.4, 9.0]
    assert fly(thrifty([Fixed(0.0)]), proposals, wishes) == [False, True, True, True, False, False]
    assert fly(thrifty([Fixed(0.0)], least=1), [1.0, 0.5, 0.5], [1.0, 0.5, 0.5]) == [True, True, False]
    assert fly(thrifty([Fixed(0.0)], patience=2), [1.0, 0.5, 1.0, 1.0], [0.0] * 4) == [False, False, False, True]


def test_the_learner_is_left_alone_until_it_doubts() -> None:
    """What the expert would do must not decide whether it is called: that would be a query."""
    assert not any(fly(thrifty([Fixed(0.0)]), [0.1] * 5, [9.0] * 5))


def test_disagreement_is_a_variance_in_units_of_the_data() -> None:
    opinions = np.array([[[1.0, 0.0]], [[3.0, 0.0]]])
    assert disagreement(opinions, ActionScale(np.array([1.0, 1.0]))) == pytest.approx([0.5])
    assert disagreement(opinions, ActionScale(np.array([2.0, 1.0]))) == pytest.approx([0.125])


@pytest.mark.slow
def test_thrifty_asks_less_counts_what_it_asks_and_learns(tmp_path: Path, demos: list[Episode]) -> None:
    run = tmp_path / "run"
    train(run, THRIFTY, demos)
    rows = read_metrics(run)[1:]
    for number, row in enumerate(rows, start=1):
        flights = flights_of(run, number)
        assert row["queries"] == sum(int(f.asked.sum()) for f in flights) < row["flight_steps"]
        for flight in flights:
            np.testing.assert_array_equal(flight.asked, flight.is_intervention)
            np.testing.assert_array_equal(flight.actions[flight.asked], flight.expert_actions[flight.asked])
        starts = sum(int((np.diff(f.is_intervention, prepend=False) & f.is_intervention).sum()) for f in flights)
        assert row["interventions"] == starts
    probes = list(open_dataset(run / "rounds" / "001" / "alone", failures=True))
    assert FlightCosts.of(probes).queries == 0
    assert len(probes) == 5


def test_the_expert_hands_back_within_some_mean_discrepancies(demos: list[Episode], tmp_path: Path) -> None:
    """A policy that always says 0 is away from the labels by their own size."""
    policy = BC.train(demos, POLICY, run=tmp_path / "bc", progress=False)
    policy.act = lambda obs: np.zeros((len(obs["error"]), 1))  # type: ignore[method-assign]
    labels = np.concatenate([demo.labels for demo in demos])
    of = Round(1, 0, [policy, policy], demos, [])
    for agreement in (1.0, 3.0):
        gate = ThriftyGate(ensemble=2, agreement=agreement, risk=False).open(of)
        assert isinstance(gate, _Thrifty)
        mean = gate.scale.distance(np.zeros_like(labels), labels).mean()
        assert gate.thresholds.discrepancy == pytest.approx(agreement * mean, rel=1e-5)


def test_a_supervisor_takes_over_late_and_hands_back_content(demos: list[Episode], tmp_path: Path) -> None:
    gate = Corrector(take=1.0, give=0.5, patience=2, least=2)
    gate.reset(np.ones(1, bool))
    flew, told = np.zeros(1, bool), []
    for distance in (2.0, 0.0, 2.0, 2.0, 0.7, 0.4, 0.4, 0.4):
        flew = gate.holds({}, np.array([distance]), flew)
        told.append(bool(flew[0]))
    assert told == [False, False, False, True, True, True, False, False]
    human = HumanGate(supervisor=Corrector(take=0.3, give=0.2, patience=2, least=3))
    train(tmp_path / "run", replace(DAGGER, rounds=1, gate=human), demos)
    (flown,) = (read_metrics(tmp_path / "run")[1],)
    assert 0 < flown["queries"] == flown["expert_steps"] < flown["flight_steps"]


# --- noise


def test_noise_has_the_covariance_and_correlation_of_the_errors(demos: list[Episode], tmp_path: Path) -> None:
    """Errors of a policy that always says 0 are the labels themselves."""
    policy = BC.train(demos, POLICY, run=tmp_path / "bc", progress=False)
    labels = np.concatenate([demo.executed_actions for demo in demos])
    policy.act = lambda obs: np.zeros((len(obs["error"]), 1))  # type: ignore[method-assign]
    noise = Noise.of(policy, demos, scale=4.0, coloured=True)
    assert (noise.root @ noise.root.T)[0, 0] == pytest.approx(4.0 * (labels**2).mean(), rel=1e-6)
    assert 0.9 < noise.correlation <= 0.98, "the course is a slow sine"
    assert Noise.of(policy, demos, scale=4.0, coloured=False).correlation == 0.0

    shaken = Disturbed(Fixed(0.0), noise)
    shaken.attach(Corridor(400))
    shaken.begin(np.arange(400))
    flown = np.stack([shaken.act({"error": np.zeros((400, 1))})[:, 0] for _ in range(30)])
    assert (shaken.expert_action == 0.0).all(), "labels have no noise"
    assert flown.std() == pytest.approx(abs(noise.root[0, 0]), rel=0.1)
    assert (flown[1:] * flown[:-1]).mean() / (flown**2).mean() == pytest.approx(noise.correlation, abs=0.03)
    again = Disturbed(Fixed(0.0), noise)
    again.begin(np.array([17]))
    assert again.act({"error": np.zeros((1, 1))})[0, 0] == flown[0, 17], "by the episode, not by its place"


def test_dart_labels_a_disturbed_expert(demos: list[Episode], tmp_path: Path) -> None:
    train(tmp_path / "run", DART, demos)
    rows = read_metrics(tmp_path / "run")
    assert rows[1]["noise"] > 0.0
    for flight in flights_of(tmp_path / "run", 1):
        assert flight.asked.all()
        assert np.abs(flight.actions - flight.expert_actions).max() > 1e-3
    assert rows[-1]["evaluate/success"] >= rows[0]["evaluate/success"]
