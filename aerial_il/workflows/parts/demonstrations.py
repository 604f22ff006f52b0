"""Demonstrations for the commands that learn from them."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice, zip_longest

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import camera_name
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.joined import Joined
from aerial_il.data.latency import with_latency
from aerial_il.data.reading import AS_IT_SAYS, Reading
from aerial_il.policies.parts.language import in_words

log = logging.getLogger(__name__)


def open_demonstrations(
    path: str,
    *,
    limit: int | None,
    others: Sequence[str] = (),
    weights: Sequence[float] = (),
    latency_ms: float | None = None,
    language: bool = False,
    images: Sequence[str] = (),
    failures: bool = False,
    states: bool = False,
    reading: Reading = AS_IT_SAYS,
) -> Iterable[Episode]:
    """Open what is learned from.

    Args:
        path: of the dataset. limit: how many successful episodes to take, or None for all episodes.
        others: paths of further datasets, without a limit. weights: the share of each of them.
        latency_ms: that episodes are shifted to, or None, see :mod:`aerial_il.data.latency`.
        language: whether they say in words what they do, see :mod:`aerial_il.policies.parts.language`.
        images: fields to decode. failures: whether failed flights are learned from too.
        states: whether the simulator's states are wanted, for demonstrations that are recorded once more.
        reading: answers to what the format does not say.

    Raises:
        InvalidValueError: there are fewer of them than ``limit``, or failures are wanted as well as a limit; or the
            datasets cannot be learned from together.
    """
    wanted = {"images": images, "failures": failures, "states": states, "reading": reading}
    if others:
        opened = [_open_all(each, **wanted) for each in (path, *others)]
        return Joined([each.mapped(in_words) for each in opened] if language else opened, weights)
    episodes = _open_all(path, **wanted) if limit is None else _open_some(path, limit, **wanted)
    if latency_ms is not None:
        episodes = _changed(episodes, partial(with_latency, latency_ms=latency_ms))
    return _changed(episodes, in_words) if language else episodes


def _changed(episodes: Iterable[Episode], change: Callable[[Episode], Episode]) -> Iterable[Episode]:
    return episodes.mapped(change) if isinstance(episodes, Dataset) else [change(each) for each in episodes]


def _open_some(
    path: str, limit: int, *, images: Sequence[str], failures: bool, states: bool, reading: Reading
) -> Iterable[Episode]:
    """Take the first successful episodes only; from a folder of several tasks by turns, one of each that has any left.

    Raises:
        InvalidValueError: see :func:`open_demonstrations`.
    """
    if failures:
        raise InvalidValueError(
            f"dataset.episodes={limit} counts successes: leave it out when failures are learned from too."
        )
    dataset = open_dataset(path, **reading.answers, states=states)
    solved = [(episode for episode in task if episode.success) for task in dataset.by_task()]
    chosen = list(islice(_by_turns(solved), limit))
    if len(chosen) < limit:
        raise InvalidValueError(
            f"{path} has {len(chosen)} successful demonstrations; dataset.episodes={limit} asks for more. "
            "Collect more into it, or leave dataset.episodes=null for all."
        )
    if images:  # one after the other, as the algorithm takes them: they may not fit into memory
        return open_dataset(path, **reading.answers, cameras=tuple(images), states=states).only(
            [episode.uid for episode in chosen]
        )
    return chosen


def _open_all(path: str, *, images: Sequence[str], failures: bool, states: bool, reading: Reading) -> Dataset:
    """Open all of a dataset; see :func:`open_demonstrations`."""
    return open_dataset(path, **reading.answers, cameras=tuple(images), failures=failures, states=states)


def warn_of_changes(path: str, reading: Reading = AS_IT_SAYS) -> None:
    """Say what has changed since demonstrations were recorded: the meaning of their tier, the engine, or cameras."""
    from aerial_il.data.provenance import engine_of
    from aerial_il.suite.changes import engine_note, tier_note

    for note in dict.fromkeys(
        note
        for episode in open_dataset(path, **reading.answers, states=False).one_of_each()
        if not episode.spec.is_outside
        for note in (tier_note(episode.spec), engine_note(engine_of(episode.provenance)), camera_note(episode))
        if note
    ):
        log.warning("%s: %s It is learned from as it is.", path, note)


def camera_note(episode: Episode) -> str:
    """Return a sentence where the robot has other cameras today than recorded the images of a flight, else nothing."""
    from aerial_il import robots
    from aerial_il.policies.perception.cameras import changed_cameras

    spec = episode.spec
    if spec.robot not in robots.names():
        return ""
    seen = [camera_name(field.name) for field in spec.observation.of_group("image")]
    changed = changed_cameras(episode.model_xml, spec.robot, seen)
    return f"Its images were taken through other cameras than {spec.robot} has today ({changed})." if changed else ""


def check_origin(path: str, expected: Mapping[str, str], reading: Reading = AS_IT_SAYS) -> None:
    """Refuse a dataset with demonstrations of another robot, task, tier or action level than ``expected``."""
    from aerial_il.algorithms.supervised.training_set import check_recorded

    for part in open_dataset(path, **reading.answers, states=False).parts if expected else ():
        check_recorded(part.spec, expected)


def _by_turns(queues: Sequence[Iterator[Episode]]) -> Iterator[Episode]:
    """Yield one of each queue, then the next of each, until all of them are empty."""
    return (episode for turn in zip_longest(*queues) for episode in turn if episode is not None)
