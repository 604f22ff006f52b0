"""Give a recorded episode other labels: its steps and pictures stay as they are, and what was said of it is kept."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import NO_CONTROLLER
from aerial_il.data.folder import DEMOS, FAILURES
from aerial_il.data.provenance import HUMAN, INSTRUCTION, instruction_of, operator_of
from aerial_il.data.recording.reader import Head, check_channels, read_head, read_outcome
from aerial_il.data.recording.report import Report
from aerial_il.data.recording.scan import scan
from aerial_il.data.recording.schema import Layout
from aerial_il.data.recording.writer import EpisodeWriter
from aerial_il.data.table import TAG, Row

RELABELLED = "relabelled"  # in the provenance: what was said before, the oldest first


@dataclass(frozen=True)
class Labels:
    """What an episode is given; None for what stays as it is."""

    success: bool | None = None
    operator: str | None = None
    instruction: str | None = None
    tag: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        return {name: value for name, value in asdict(self).items() if value is not None}

    def require_types(self) -> None:
        """Refuse labels that somebody else's file says and that are none."""
        if any(not isinstance(value, bool if name == "success" else str) for name, value in self.given.items()):
            raise ValueError(f"{self.given} are no labels")

    def kind(self, before: str) -> str:
        """Return the folder in which an episode belongs that was in the folder ``before``."""
        return before if self.success is None else DEMOS if self.success else FAILURES


def check_given(rows: Iterable[Row], labels: Labels) -> None:
    """Refuse labels that say nothing, or that not all of these episodes can have.

    Raises:
        InvalidValueError: nothing is given, or an operator to an episode that no person flew, or success to one that
            ended in a crash, which no reader would believe.
    """
    if not labels.given:
        raise InvalidValueError("Say what to change: success=, operator=, instruction= or tag=.")
    for row in rows:
        if labels.success and row["failure"] == "crash" and row["controller"] != NO_CONTROLLER:
            raise InvalidValueError(
                f"success=true: {row['uid']} ended in a crash. Leave such out: where=\"failure != 'crash'\"."
            )
        if labels.operator is not None and not row["operator"]:
            raise InvalidValueError(
                f"operator={labels.operator}: {row['uid']} was flown by {row['policy']}, not by a person. "
                "Leave such out: where=\"operator != ''\"."
            )


def relabel(source: Path, target: Path, labels: Labels, where: str, *, part: Path) -> None:
    """Write the episode of ``source`` as ``target``, with other labels.

    Args:
        labels: what it is given. where: how it was asked for, for its provenance. part: the file that its unfinished
            one is named after.

    Raises:
        DemoError: it cannot be read.
        StorageError: ``target`` cannot be written.
    """
    contents = scan(source)
    head, outcome = read_head(source, contents), read_outcome(source, contents)
    check_channels(source, contents, head.form.definitions)
    messages = head.form.read(Report(source), contents, outcome.steps)
    before = _labels_of(head, success=outcome.success)
    changed = {"was": {name: before[name] for name in labels.given}, "now": labels.given, "where": where}
    origin = {**head.provenance, RELABELLED: [*head.provenance.get(RELABELLED, ()), changed]}
    if labels.operator is not None:
        before_name, human, _ = str(origin["policy"]).partition(HUMAN)
        origin["policy"] = f"{before_name}{human}{labels.operator}"
    if labels.tag is not None:
        origin[TAG] = labels.tag
    layout = head.layout
    if labels.instruction is not None:
        layout = Layout(replace(layout.spec, instruction=labels.instruction), layout.ctrl_size, layout.extras)
        origin.pop(INSTRUCTION, None)  # words of its own, which went before those of its task
    writer = EpisodeWriter(part, layout, uid=head.uid, provenance=origin, model_xml=head.model_xml)
    success = outcome.success if labels.success is None else labels.success
    try:
        ended = {"note": outcome.note, "made_of": outcome.made_of}
        writer.finish(messages.rows, messages.images, success=success, path=target, **ended)
    except BaseException:
        writer.discard()
        raise


def _labels_of(head: Head, *, success: bool) -> dict[str, Any]:
    origin = head.provenance
    instruction = instruction_of(origin, head.layout.spec)
    said = {"operator": operator_of(origin), "instruction": instruction, "tag": origin.get(TAG, "")}
    return {"success": success, **said}
