"""How recordings are written down: steps in columns, and a few messages of them for eyes."""

from collections.abc import Mapping
from functools import cached_property, lru_cache
from itertools import count

import numpy as np

from aerial_il.core.errors import SimulationDivergedError
from aerial_il.data.recording.decoding import Messages, check_shown, images_of, read_images, read_records
from aerial_il.data.recording.encoding import columns, messages
from aerial_il.data.recording.encoding.packing import Packer, first_not_finite
from aerial_il.data.recording.encoding.topics import Block, Topic, definitions_of, nanoseconds, packer_of, place_of
from aerial_il.data.recording.report import Report
from aerial_il.data.recording.scan import Contents, Stream
from aerial_il.data.recording.schema import Layout

STEP = "/step"
STEP_CHANNEL = 1
VIEW_PERIOD_S = 0.1  # of what people look at

MAX_ROWS_BYTES = 96 << 20  # of all steps, which a message that repeats them can claim


class Form:
    """The topics of one environment's recordings, and the bytes of its steps.

    Args:
        layout: what a step is made of.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout, views, channels = layout, layout.views, count(STEP_CHANNEL)
        self.step = Topic(next(channels), STEP, messages.STEPS)
        self.views = [*views.observed(channels), *views.acted(channels), *views.further(channels)]
        self.cameras = views.cameras(channels)
        self.definitions = definitions_of([self.step, *self.views, *self.cameras])
        self.stride = max(1, round(VIEW_PERIOD_S / layout.spec.control_dt_s))

    @cached_property
    def view(self) -> np.dtype:
        """Structured dtype of a step as the views' messages are made of it."""
        layout, fields = self.layout, ("observation", "reward", "action", *self.layout.extras)
        quats = [(f"quat_{body}", "<f8", (4,)) for body in layout.views.bodies]
        stamps = [("time_ns", "<u8"), ("sec", "<i4"), ("nanosec", "<u4"), ("step", "<u4"), ("padding", "u1", (4,))]
        return np.dtype([*((name, place_of(layout.row, name)[0]) for name in fields), *quats, *stamps])

    def step_record(self, rows: np.ndarray, first: int, *, seed: int) -> bytes:
        """Return the record of the steps ``rows`` (k,) from number ``first`` on.

        Raises:
            SimulationDivergedError: a number that must be is not finite; ``seed`` is whose.
        """
        layout, numbers = self.layout, self.layout.numbers(rows)
        steps = columns.Steps(first, int(nanoseconds(rows["sim_time"][0])), numbers)
        record = columns.to_record(STEP_CHANNEL, steps, layout.finite_width)
        if record is None:
            bad = first_not_finite(numbers[:, : layout.finite_width])
            assert bad is not None
            name, where = layout.name_of_number(bad[1])
            raise SimulationDivergedError(f"{name}{where} is not finite", seed=seed, step=first + bad[0])
        return record

    def viewed(self, rows: np.ndarray, first: int) -> np.ndarray:
        """Return those of the steps ``rows`` (k,), from number ``first`` on, that people will look at."""
        chosen = slice(-first % self.stride, None, self.stride)
        seen = np.zeros(len(rows[chosen]), self.view)
        for name in ("observation", "reward", "action", *self.layout.extras):
            seen[name] = rows[name][chosen]
        seen["step"] = np.arange(first, first + len(rows))[chosen]
        seen["time_ns"] = nanoseconds(rows["sim_time"][chosen])
        return seen

    def view_records(self, seen: np.ndarray) -> np.ndarray:
        """Return the records (k, B) uint8 of all views of some steps (k,) of :meth:`viewed`."""
        seen["sec"], seen["nanosec"] = np.divmod(seen["time_ns"], np.uint64(10**9))
        for name, quats in self.layout.views.quats(seen["observation"]).items():
            seen[name] = quats
        return self._packer.pack(seen)

    @cached_property
    def view_starts(self) -> np.ndarray:
        """(c,) where the records of each topic begin in a row of :meth:`view_records`."""
        return np.cumsum([0, *(len(topic.record_template) for topic in self.views[:-1])])

    def read(self, report: Report, contents: Contents, steps: int) -> Messages:
        """Decode and check a whole episode of ``steps`` steps."""
        rows, records = self._rows(report, contents, steps + 1)
        if len(rows) != steps + 1:
            report.fail("has another number of steps.", STEP, expected=steps + 1, got=len(rows))
        ending = self.layout.numbers(rows)[-1, self.layout.seen_width :]
        if ending.view(np.uint64).any():
            report.fail("has an outcome where the flight had ended.", STEP, step=steps)
        shown = self._check_views(report, contents, rows[:-1])
        times = nanoseconds(rows["sim_time"])
        images = {c.field: read_images(report, c, contents, times) for c in self.cameras}
        filmed = {c.name: list(contents.messages[c.channel]) for c in self.cameras}
        return Messages(rows, images, {STEP: records, **shown, **filmed})

    def read_whole_steps(self, report: Report, contents: Contents) -> Messages:
        """Decode and check as many steps as have all their messages, of an episode that may lack its end."""
        rows, _ = self._rows(report, contents)
        times, reached = nanoseconds(rows["sim_time"]), {c.field: images_of(c, contents) for c in self.cameras}
        count = min([len(rows), *reached.values()])
        images = {c.field: read_images(report, c, contents, times[: reached[c.field]]) for c in self.cameras}
        return Messages(rows[:count], {name: found[:count] for name, found in images.items()}, {})

    @cached_property
    def _packer(self) -> Packer:
        return packer_of(self.views, self.view)

    def _rows(self, report: Report, contents: Contents, most: int | None = None) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return all steps of a file, and their records; ``most``: no more than these."""
        records = list(contents.messages.get(STEP_CHANNEL, Stream()))
        width, pieces, done = self.layout.width, [], 0
        limit = MAX_ROWS_BYTES // self.layout.row.itemsize
        for record in records:
            try:
                steps = columns.from_record(record, width)
            except ValueError as error:
                report.fail(f"has a message that {error}.", STEP, step=done)
            if steps.first != done:
                report.fail("is out of order.", STEP, step=done, expected=done, got=steps.first)
            done += len(steps.numbers)
            if done > (limit if most is None else min(limit, most)):
                report.fail("has too many steps.", STEP, expected=f"at most {min(limit, most or limit)}", got=done)
            time = int(nanoseconds(steps.numbers[:1, 0])[0]) if np.isfinite(steps.numbers[0, 0]) else None
            if steps.time_ns != time:
                report.fail("contradicts the rest of the file.", STEP, step=steps.first, field="sim_time")
            pieces.append(steps.numbers)
        numbers = np.concatenate([np.empty((0, width)), *pieces])
        return numbers.view(self.layout.row)[:, 0], records

    def _check_views(self, report: Report, contents: Contents, rows: np.ndarray) -> Mapping[str, list[np.ndarray]]:
        """Require that what people look at shows what is exact; return its records."""
        chosen = slice(None, None, self.stride)
        block: Block = {name: rows[name][chosen] for name in ("observation", "reward", "action", *self.layout.extras)}
        block = {**block, **self.layout.views.quats(block["observation"])}
        steps, times = np.arange(len(rows))[chosen], nanoseconds(rows["sim_time"][chosen])
        shown, report = {}, Report(report.path, every=self.stride)
        for topic in self.views:
            shown[topic.name] = [records := read_records(report, topic, contents, steps)]
            check_shown(report, topic, records, times, block)
        return shown


@lru_cache(maxsize=8)
def form_of(layout: Layout) -> Form:
    """Return the topics of a layout, the same each time."""
    return Form(layout)
