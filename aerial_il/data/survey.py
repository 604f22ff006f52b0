"""What opening a dataset shows: which episodes can be used, of what environment they are, and what no file says of it.

Demonstrations that bring no specification are looked at once when they are opened: what most of them have in common is
their environment, and one that differs, or cannot be used, is left out with a word. What is unknown is taken for
something, which is said, with the key that answers it.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from aerial_il.core.errors import DemoError, InvalidValueError, UnknownNameError
from aerial_il.core.specs import NO_CONTROLLER, UNKNOWN, ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.borders import cuts, ends_of, oddities, piece
from aerial_il.data.check import SERIES, Gate, require_whole
from aerial_il.data.conversion import Agreed, episode, taken
from aerial_il.data.episode import Episode
from aerial_il.data.pictures import MILLIMETRE, Kind
from aerial_il.data.source import Raw, Source, Wanted

log = logging.getLogger(__name__)
MARGIN = 1e-6  # of the size of the actions that were seen, around their bounds; one that never varies has bounds, too
ANOTHER_UNIT = 100.0  # times as large, or as small, as in other episodes: it may be told in another unit
ACTION = "action"
Loader = Callable[[], Episode]


@dataclass
class Survey:
    """What opening a dataset has shown.

    Attributes:
        loaders: uid -> function that reads the episode, and raises :class:`DemoError` if it cannot be used.
        left_out: uid -> why it is not among them. notes: uid -> what is odd about it, or was mended.
        assumed: what is taken for granted, as no file says it. strict: whether to leave nothing out.
        files: uid -> the file of a recorded episode, where each has one of its own.
    """

    loaders: dict[str, Loader] = field(default_factory=dict, repr=False)
    left_out: dict[str, DemoError] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)
    strict: bool = False
    files: Mapping[str, Path] = field(default_factory=dict)

    @contextmanager
    def leaving_out(self, uid: str) -> Iterator[None]:
        """Leave an episode out that is refused within."""
        try:
            yield
        except DemoError as error:
            if self.strict:
                raise
            self.left_out[uid] = error

    def note(self, uid: str, text: str) -> None:
        self.notes.setdefault(uid, []).append(text)


@dataclass(frozen=True)
class Mark:
    """What of one demonstration has to agree with others.

    Attributes:
        read: returns what it is a part of, steps ``first`` to before ``last``.
        fields: what each field holds. low, high: (Da,) of its actions. states: width of the simulator's.
        sizes: how large the numbers of each field are. judged: whether it is marked as a success or a failure.
        said: what else its file holds: rewards, ends, times. open: whether it may have gone on after its end.
    """

    read: Callable[[], Raw]
    first: int
    last: int
    fields: dict[str, Kind]
    low: np.ndarray
    high: np.ndarray
    states: int
    sizes: dict[str, float]
    judged: bool
    said: frozenset[str]
    open: bool

    @staticmethod
    def of(source: Source, raw: Raw, read: Callable[[], Raw], first: int, last: int) -> Mark:
        fields = {name: Kind.of(values, source.groups.get(name, "proprio")) for name, values in raw.obs.items()}
        actions = np.asarray(raw.actions)
        numbers = {ACTION: actions, **{n: np.asarray(v) for n, v in raw.obs.items() if fields[n].group != "image"}}
        return Mark(
            read=read,
            first=first,
            last=last,
            fields=fields,
            low=actions.min(0),
            high=actions.max(0),
            states=0 if raw.states is None else int(np.prod(raw.states.shape[1:])),
            sizes={n: float(np.median(np.abs(v.reshape(len(v), -1)).max(1, initial=0))) for n, v in numbers.items()},
            judged=raw.success is not None,
            said=frozenset(name for name in (*SERIES, "states") if getattr(raw, name) is not None)
            | {f"next {name}" for name in raw.next_obs},
            open=not ends_of(replace(raw, done=raw.done if raw.success else None))[-1],
        )


def surveyed(source: Source, wanted: Wanted) -> Survey:
    """Look at what a format hands over, and say which of it can be used.

    Raises:
        DemoError: nothing can be used; or something cannot, and ``wanted`` is strict.
        InvalidValueError, UnknownNameError: there is no camera or part of the dataset of that name.
    """
    source, survey = source.part(wanted.filter_key), Survey(strict=wanted.strict, files=source.files)
    if wanted.answered and (source.recorded or source.spec):
        raise InvalidValueError(f"{source.path} was recorded here and says it itself: leave out {wanted.answered}.")
    for uid, read in source.recorded.items():
        survey.loaders[uid] = partial(_recorded, source.files.get(uid), source.path, uid, read)
    if source.spec is not None:
        _check_cameras(source.spec, wanted)
        kinds = {f.name: Kind(f.shape, f.group, f.dtype) for f in source.spec.observation.fields}
        agreed = Agreed(source.spec, kinds, source.spec.control_dt_s, judged=False, declared=True)
        for uid, read in source.raw.items():
            survey.loaders[uid] = partial(_load, source, wanted, agreed, uid, read)
    elif source.raw:
        _survey(source, wanted, survey)
    if not survey.loaders and survey.left_out:
        raise next(iter(survey.left_out.values()))
    _say(source, survey)
    return survey


def _recorded(file: Path | None, path: Path, uid: str, read: Loader) -> Episode:
    found = read()
    require_whole(Gate(path, uid) if file is None else Gate(file), found)
    return found if found.uid == uid else replace(found, uid=uid)  # a file goes by its name


def _load(source: Source, wanted: Wanted, agreed: Agreed, uid: str, read: Callable[[], Raw], *rows: int) -> Episode:
    """Return an episode, or some of its ``rows``, from the first one to before the last."""
    gate = Gate(source.path, uid)
    raw, _ = taken(gate, read(), wanted)
    note = f"read from {source.path.name}, {source.kind}"
    return episode(gate, piece(raw, *rows) if rows else raw, wanted, agreed, note=note)


def _survey(source: Source, wanted: Wanted, survey: Survey) -> None:
    """Agree on a specification of raw demonstrations, and judge each by it."""
    period_s, marks = wanted.control_dt or source.control_dt_s, dict[str, Mark]()
    for uid, read in source.raw.items():
        with survey.leaving_out(uid):
            marks |= _marked(source, wanted, survey, uid, read, period_s)
    kinds = _shared([*marks.values()])
    if dropped := sorted({name for mark in marks.values() for name in mark.fields} - kinds.keys()):
        survey.assumed.append(f"{', '.join(dropped)} is not in all demonstrations, and left out")
    marks = _alike(source, survey, marks, kinds)
    if not marks:
        return
    spec = _spec(source, kinds, [*marks.values()], period_s)
    _check_cameras(spec, wanted)
    agreed = Agreed(spec, kinds, period_s, judged=any(mark.judged for mark in marks.values()))
    survey.assumed += _unsaid(source, wanted, agreed, [*marks.values()])
    _compare(survey, marks)
    for uid, mark in marks.items():
        survey.loaders[uid] = partial(_load, source, wanted, agreed, uid, mark.read, mark.first, mark.last)


def _marked(
    source: Source, wanted: Wanted, survey: Survey, uid: str, read: Callable[[], Raw], period_s: float | None
) -> dict[str, Mark]:
    """Return what one demonstration is like, or each of those that it has to be cut into."""
    raw, moved = taken(Gate(source.path, uid), read(), wanted)
    if moved is not None:
        survey.note(uid, f"has rows out of order, first at step {moved}; they are put in order by their frame_index.")
    for odd in oddities(raw, borders=source.borders):
        survey.note(uid, odd)
    found, marks = cuts(raw, period_s, borders=source.borders), dict[str, Mark]()
    if source.borders and found:
        survey.note(uid, f"is cut at {len(found)} of its steps, first at step {min(found)}: {found[min(found)]}.")
    held = read if source.borders else lambda: raw
    begins = [0, *sorted(found)]
    for number, (first, last) in enumerate(zip(begins, [*begins[1:], len(raw.actions)], strict=True)):
        name = uid if source.borders and not found else f"{uid}_{number:06d}"
        with survey.leaving_out(name):
            part = piece(raw, first, last)
            Gate(source.path, name).require_usable(part, period_s)
            marks[name] = Mark.of(source, part, held, first, last)
    if alone := sum(mark.last - mark.first == 1 for mark in marks.values() if not source.borders):
        survey.note(uid, f"has {alone} transitions of {len(raw.actions)} that no other one comes before or after.")
    return marks


def _most[T: Hashable](values: Iterable[T]) -> T:
    """Return the most frequent value, the first of those that are."""
    return Counter(values).most_common(1)[0][0]


def _shared(marks: Sequence[Mark]) -> dict[str, Kind]:
    """Return the fields that more than half of the demonstrations have, and what most of these hold in them."""
    kinds: dict[str, list[Kind]] = {}
    for mark in marks:
        for name, kind in mark.fields.items():
            kinds.setdefault(name, []).append(kind)
    return {name: _most(found) for name, found in kinds.items() if 2 * len(found) > len(marks)}


def _alike(source: Source, survey: Survey, marks: dict[str, Mark], kinds: Mapping[str, Kind]) -> dict[str, Mark]:
    """Return the demonstrations that agree with most of the others; leave out what does not."""
    actions = [mark.low.shape for mark in marks.values()]
    for uid, mark in marks.items():
        with survey.leaving_out(uid):
            _require_alike(Gate(source.path, uid), mark, _most(actions), kinds)
    return {uid: mark for uid, mark in marks.items() if uid not in survey.left_out}


def _require_alike(gate: Gate, mark: Mark, actions: tuple[int, ...], kinds: Mapping[str, Kind]) -> None:
    problem = "has {} of another {} than others or its specification."
    if mark.low.shape != actions:
        gate.refuse(problem.format("actions", "shape"), expected=actions, got=mark.low.shape)
    for name, kind in kinds.items():
        if (found := mark.fields.get(name)) is None:
            gate.refuse(f"lacks {name}.", got=sorted(mark.fields))
        if found.shape != kind.shape:
            gate.refuse(problem.format(name, "shape"), expected=kind.shape, got=found.shape)
        if found != kind:
            gate.refuse(problem.format(name, "type"), expected=kind.dtype, got=found.dtype)


def _compare(survey: Survey, marks: Mapping[str, Mark]) -> None:
    """Note demonstrations that lack what others have, or whose numbers are of another order: units may differ."""
    every = frozenset().union(*(mark.said for mark in marks.values()))
    for uid, mark in marks.items():
        if lacking := sorted(every - mark.said):
            survey.note(uid, f"lacks {', '.join(lacking)}, which others have.")
    for name in {name for mark in marks.values() for name in mark.sizes} if len(marks) > 1 else ():
        sizes = {uid: mark.sizes[name] for uid, mark in marks.items() if mark.sizes.get(name)}
        middle = float(np.median([*sizes.values()])) if len(sizes) > 2 else min(sizes.values(), default=0.0)
        for uid, size in sizes.items():
            if not 1 / ANOTHER_UNIT < size / middle < ANOTHER_UNIT:
                times = f"{size / middle:.3g} times"
                survey.note(uid, f"has {name} {times} as large as others: is it told in another unit?")


def _unsaid(source: Source, wanted: Wanted, agreed: Agreed, marks: Sequence[Mark]) -> Iterator[str]:
    """Yield what is taken for granted because neither the file nor an answer says it."""
    if agreed.period_s is None:
        yield "a control period of 1 s, as none is said (control_dt=S)"
    if not agreed.judged and wanted.success is None:
        yield "all demonstrations as successes, as none is said to be (success=reward, return:R, terminal, ...)"
    if not any("rewards" in mark.said for mark in marks):
        yield "rewards of zero, as none is said"
    if (count := sum(mark.open for mark in marks)) and wanted.terminals is None:
        yield f"{count} ends as open, as it is not said that they are terminal (terminals=true where they are)"
    for name in (name for name, kind in agreed.kinds.items() if kind.scale == MILLIMETRE):
        yield f"the whole numbers of the depth images {name} as millimetres"
    if source.filters and wanted.filter_key is None:
        yield f"all episodes, although it names parts of them (filter_key={', '.join(sorted(source.filters))})"


def _spec(source: Source, kinds: Mapping[str, Kind], marks: Sequence[Mark], period_s: float | None) -> EnvSpec:
    """Return the specification of what all demonstrations have in common."""
    low, high = np.min([m.low for m in marks], 0).astype(float), np.max([m.high for m in marks], 0).astype(float)
    size = np.max([high - low, np.abs(low), np.abs(high)], 0)
    margin, states = MARGIN * np.where(size > 0, size, 1.0), {mark.states for mark in marks}
    labels = source.labels.get(ACTION) or tuple(f"a{i}" for i in range(len(low)))
    fields = (Field(n, k.shape, k.group, k.dtype, labels=source.labels.get(n, ())) for n, k in kinds.items())
    return EnvSpec(
        robot=source.robot,
        task=source.task,
        tier=UNKNOWN,
        observation=ObservationSpec(tuple(fields)),
        action=ActionSpec(UNKNOWN, labels, ("",) * len(labels), low - margin, high + margin),
        control_dt_s=period_s or 1.0,
        max_steps=max(mark.last - mark.first for mark in marks),
        instruction=source.instruction,
        subtasks=(),
        state_size=states.pop() if len(states) == 1 else 0,
        controller=NO_CONTROLLER,
    )


def _check_cameras(spec: EnvSpec, wanted: Wanted) -> None:
    names = [each.name for each in spec.observation.of_group("image")]
    for name in () if isinstance(wanted.cameras, bool) else wanted.cameras:
        if name not in names:
            raise UnknownNameError("camera", name, names, "Leave it out: policy.images=[]")


def _say(source: Source, survey: Survey) -> None:
    """Log what was left out, what is odd, and what is taken for granted; the same thing once."""
    path, see, count = source.path, f"See: aerial-il validate {source.path}", len(survey.left_out)
    if count:
        first = next(iter(survey.left_out.values()))
        _warn(f"{count} of {count + len(survey.loaders)} episodes are left out, the first as {first} {see}")
    if survey.notes:
        uid, notes = next(iter(survey.notes.items()))
        _warn(f"{path}: {len(survey.notes)} episodes are odd; {uid} {notes[0]} {see}")
    if survey.assumed:
        _warn(f"{path}: taken for granted: {'; '.join(survey.assumed)}.")
    if source.unread:
        _warn(f"{path}: not read: {'; '.join(source.unread)}.")


@cache
def _warn(text: str) -> None:
    log.warning("%s", text)
