"""The scripted judge prefers good actions, not late states; tricks that fool a sum of rewards do not fool it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.data.preferences.judge import ScriptedJudge
from aerial_il.data.preferences.pairs import Pair, Segment, draw_pairs
from tests.algorithms.drift import SPEC
from tests.algorithms.stateless_batch import episode_of

JUDGE = ScriptedJudge(horizon_s=2.0, followed=0.25, margin=0.01, flipped=0.0, seed=0)
GOAL, STRIDE, IDLE, LENGTH = 1.0, 0.05, 12, 6
LONG = replace(SPEC, max_steps=60)


def flight(number: int, moves: Sequence[float], *, success: bool) -> Episode:
    """Move along the line from where the number says, paid by nearness; success ends it."""
    start = 0.02 * (number % 5)
    position = start + np.concatenate([[0.0], np.cumsum(moves)])[:, None]
    obs = {"position": position, "goal": np.full_like(position, GOAL)}
    made = episode_of(LONG, number, obs, np.array(moves)[:, None], rewards=1.0 - np.abs(GOAL - position[1:, 0]))
    return replace(
        made, success=success, truncated=np.arange(len(moves)) == len(moves) - 1 if not success else made.truncated
    )


def quick(number: int) -> Episode:
    return flight(number, [STRIDE] * 20, success=True)


def idling(number: int, after: int) -> Episode:
    """Stand still for a while on the way."""
    return flight(number, [STRIDE] * after + [0.0] * IDLE + [STRIDE] * (20 - after), success=True)


def stuck(number: int) -> Episode:
    """Stand still near the goal until time is up."""
    return flight(number, [STRIDE] * 16 + [0.0] * 44, success=False)


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    return [
        *(quick(i) for i in range(20)),
        *(idling(i, after=16) for i in range(20, 30)),
        *(idling(i, after=2) for i in range(30, 40)),
        *(stuck(i) for i in range(40, 50)),
    ]


def preferred(episodes: list[Episode], *pairs: Pair, judge: ScriptedJudge = JUDGE) -> list[str]:
    return [preference.preferred for preference in judge.judge(episodes, pairs)]


def segment(episode: Episode, first: int) -> Segment:
    return Segment(episode.uid, first, LENGTH)


def test_moving_early_beats_idling_late(episodes: list[Episode]) -> None:
    """By the sum of rewards the later one would win, whatever is done in it."""
    early = [segment(episode, 1) for episode in episodes[:10]]
    late = [segment(episode, 17) for episode in episodes[20:30]]
    paid = {e.uid: e.rewards for e in episodes}
    assert all(paid[a.uid][1:7].sum() < paid[b.uid][17:23].sum() for a, b in zip(early, late, strict=True))
    pairs = [*zip(early, late, strict=True)]
    assert preferred(episodes, *pairs).count("left") >= 8
    assert preferred(episodes, *((b, a) for a, b in pairs)).count("right") >= 8


def test_lingering_where_reward_is_high_gains_nothing(episodes: list[Episode]) -> None:
    """A flight that collects reward near the goal, and never arrives, loses to those that arrive."""
    moving = [segment(episode, 12) for episode in episodes[:10]]
    lingering = [segment(episode, 14) for episode in episodes[40:]]
    assert sum(episodes[40].rewards) > 2 * sum(episodes[0].rewards)
    assert preferred(episodes, *zip(moving, lingering, strict=True)).count("left") >= 9


def test_other_rewards_change_no_answer(episodes: list[Episode]) -> None:
    pairs = draw_pairs({e.uid: len(e) for e in episodes}, 100, length=LENGTH, seed=0)
    bribed = [replace(e, rewards=np.full(len(e), 1.0 - e.success)) for e in episodes]
    assert preferred(bribed, *pairs) == preferred(episodes, *pairs)


def test_whoever_relabels_success_decides(episodes: list[Episode]) -> None:
    """As its docstring says: success is all that it goes by."""
    pairs = [(segment(a, 10), segment(b, 10)) for a, b in zip(episodes[:10], episodes[40:], strict=True)]
    lied = [replace(e, success=not e.success, truncated=np.zeros(len(e), bool)) for e in episodes]
    assert preferred(episodes, *pairs).count("left") >= 9
    assert preferred(lied, *pairs).count("right") >= 9


def test_a_share_of_the_answers_is_turned_round(episodes: list[Episode]) -> None:
    pairs = draw_pairs({e.uid: len(e) for e in episodes}, 400, length=LENGTH, seed=0)
    honest = preferred(episodes, *pairs)
    judge = replace(JUDGE, flipped=0.1)
    turned = preferred(episodes, *pairs, judge=judge)
    told = [a != b for a, b in zip(honest, turned, strict=True) if a != "equal"]
    assert 0.06 < np.mean(told) < 0.14
    assert turned == preferred(episodes, *pairs, judge=judge), "the same ones each time"
    assert turned[:50] == preferred(episodes, *pairs[:50], judge=judge), "however many are judged"


def test_without_successes_it_cannot_judge(episodes: list[Episode]) -> None:
    with pytest.raises(InvalidValueError, match=r"1 of 11 flights succeed: it takes 2.*by=hand"):
        preferred([episodes[0], *episodes[40:]], (segment(episodes[0], 0), segment(episodes[40], 1)))
