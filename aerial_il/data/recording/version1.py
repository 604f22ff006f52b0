"""Read recordings of schema version 1, in which each step had a message of each topic.

The observation's topics (``/observation``, ``/joint_states``, ``/pose/<body>``, ``/tf``) had T + 1 messages, those of
the action T: ``/step``, an ``aerial_il_msgs/Step`` with the exact values, ``/action``, ``/reward`` and the extras. The
state after the last step stood in ``/terminal``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count

import numpy as np

from aerial_il.data.recording.decoding import Messages, check_shown, read_images, read_records
from aerial_il.data.recording.encoding import messages
from aerial_il.data.recording.encoding.cdr import CdrTemplate
from aerial_il.data.recording.encoding.topics import ALL, FixedTopic, Sources, definitions_of, nanoseconds
from aerial_il.data.recording.scan import Contents
from aerial_il.data.recording.schema import Layout
from aerial_il.data.validation import Report


class Version1:
    """The topics of one environment's recordings.

    Args:
        layout: what a step is made of.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout, spec, channels = layout, layout.spec, count(1)
        self.observed = layout.views.observed(channels)
        sizes = {"state_size": spec.state_size, "ctrl_size": layout.ctrl_size, "action_size": spec.action.size}
        step, last = messages.step(**sizes), messages.step(**{**sizes, "ctrl_size": 0, "action_size": 0})
        self.step = FixedTopic(next(channels), "/step", messages.STEP, step, _whole(step))
        self.acted = [self.step, *layout.views.acted(channels)]
        sources = _whole(last, ("step", "sim_time", "state"))
        self.terminal = FixedTopic(next(channels), "/terminal", messages.STEP, last, sources)
        self.cameras = layout.views.cameras(channels)
        self.further = layout.views.further(channels)
        self.definitions = definitions_of([*self.observed, *self.acted, *self.further, self.terminal, *self.cameras])

    def read(self, report: Report, contents: Contents, steps: int) -> Messages:
        """Decode and check a whole episode of ``steps`` steps."""
        records = self._records(report, contents, observed=steps + 1, acted=steps)
        last = read_records(report, self.terminal, contents, np.array([steps]))
        times = records["/observation"]["log_time"]
        report.check_equal("/terminal", "log_time", last["log_time"], times[-1:])
        report.check_equal("/terminal", "sim_time", nanoseconds(last["body"]["sim_time"]), times[-1:])
        return self._messages(report, contents, records, {"/terminal": last})

    def read_whole_steps(self, report: Report, contents: Contents) -> Messages:
        """Decode and check as many steps as have all their messages, of an episode that may lack its end."""
        topics = [*self.observed, *self.acted, *self.further, *self.cameras]
        steps = min(len(contents.messages[topic.channel]) for topic in topics)
        for topic in topics:
            contents.messages[topic.channel] = contents.messages[topic.channel].first(steps)
        return self._messages(report, contents, self._records(report, contents, observed=steps, acted=steps), {})

    def _records(self, report: Report, contents: Contents, *, observed: int, acted: int) -> dict[str, np.ndarray]:
        steps = np.arange(observed)
        records = {topic.name: read_records(report, topic, contents, steps) for topic in self.observed}
        acting = [*self.acted, *self.further]
        return records | {topic.name: read_records(report, topic, contents, steps[:acted]) for topic in acting}

    def _messages(
        self,
        report: Report,
        contents: Contents,
        records: Mapping[str, np.ndarray],
        ending: Mapping[str, np.ndarray],
    ) -> Messages:
        """Assemble what was decoded, and compare what people look at with what is exact."""
        body, times = records["/step"]["body"], records["/observation"]["log_time"]
        acted = {name: body[name] for name in body.dtype.names or ()}
        block = dict(acted)
        for name in block.keys() & {"sim_time", "state"}:
            block[name] = np.concatenate([block[name], *(last["body"][name] for last in ending.values())])
        block["observation"] = records["/observation"]["body"]["position"]
        block |= {name: records[f"/{name}"]["body"]["position"] for name in self._layout.extras}
        rows = self._layout.rows(block)
        seen = {"observation": rows["observation"], **self._layout.views.quats(block["observation"])}
        for topic in self.observed:
            check_shown(report, topic, records[topic.name], times, seen)
        for topic in self.acted:
            check_shown(report, topic, records[topic.name], times[: len(body)], acted)
        for topic in self.further:
            report.check_equal(topic.name, "log_time", records[topic.name]["log_time"], times[: len(body)])
        report.check_equal("/step", "sim_time", nanoseconds(body["sim_time"]), times[: len(body)])
        images = {c.field: read_images(report, c, contents, times) for c in self.cameras}
        digested = {name: [part] for name, part in {**records, **ending}.items()}
        digested |= {c.name: list(contents.messages[c.channel]) for c in self.cameras}
        return Messages(rows, images, digested)


def _whole(template: CdrTemplate, names: Sequence[str] | None = None) -> Sources:
    """Return sources for the slots of a template that bear the names of fields: all, or those in ``names``."""
    slots = [slot for slot in template.dtype.names or () if slot not in ("sec", "nanosec")]
    return {slot: (slot, ALL) for slot in slots if names is None or slot in names}
