"""Kinds of failure: how a flight ended, and the sub-task that it never did."""

from collections import Counter
from collections.abc import Sequence

from aerial_il.evaluation.metrics import EpisodeRecord

WORDS = {"crash": "crash", "dropped": "dropped", "timeout": "out of time"}
ALL_DONE = "all sub-tasks done, not held"


def kind_of(episode: EpisodeRecord) -> str:
    """Return the kind of a failed flight, e.g. ``crash before lifted``; empty for a success.

    Sub-tasks are taken in the order of the task: the first that was never done is where it failed.
    """
    if episode.success:
        return ""
    missing = next((name for name, time in episode.subtasks.items() if time is None), None)
    what = WORDS[episode.end]
    return f"{what} before {missing.replace('_', ' ')}" if missing else f"{what}: {ALL_DONE}"


def kinds_of(episodes: Sequence[EpisodeRecord]) -> dict[str, int]:
    """Return kind of failure -> how many of ``episodes`` failed so, the most frequent first."""
    return dict(Counter(kind for episode in episodes if (kind := kind_of(episode))).most_common())
