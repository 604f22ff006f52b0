"""Salvage what a killed process, a full disk or a damaged file has left of an episode."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aerial_il.core.errors import DemoError
from aerial_il.core.files import sha256_of
from aerial_il.data.folder import DEMOS, FAILURES, INDEX, KINDS, SALVAGED, DatasetFolder
from aerial_il.data.recording.decoding import Messages
from aerial_il.data.recording.form import Form
from aerial_il.data.recording.reader import check_channels, read_episode, read_head, read_outcome
from aerial_il.data.recording.report import Report
from aerial_il.data.recording.scan import Contents, scan
from aerial_il.data.recording.writer import OUTCOME, EpisodeWriter, is_being_written


@dataclass(frozen=True)
class Recovered:
    """The outcome of recovering one file.

    Attributes:
        source: the file that was damaged or unfinished.
        path: the whole file made of it, or where it was set aside if nothing could be made of it.
        steps: control steps saved.
        note: what ended the reading.
    """

    source: Path
    path: Path
    steps: int
    note: str


def recover_episode(source: Path | str, target: Path | str) -> Recovered:
    """Write what precedes the first damage of ``source`` as a whole episode.

    Where the end is lost, it becomes an episode that failed and was cut short: the last observation saved is the
    terminal one, so k saved steps make k - 1 transitions.

    Raises:
        DemoError: not even two whole steps are left.
        StorageError: ``target`` cannot be written.
    """
    source, target = Path(source), Path(target)
    contents = scan(source, salvage=True)
    head = read_head(source, contents)
    check_channels(source, contents, head.form.definitions)
    messages, success, made_of = _salvage(source, contents, head.form)
    note = f"salvaged: the original {contents.damage or 'was whole'}"
    writer = EpisodeWriter(target, head.layout, uid=head.uid, provenance=head.provenance, model_xml=head.model_xml)
    try:
        writer.finish(messages.rows, messages.images, success=success, note=note, made_of=made_of)
    except BaseException:
        writer.discard()
        raise
    return Recovered(source, target, len(messages.rows) - 1, note)


def recover(path: Path | str) -> list[Recovered]:
    """Bring a dataset folder, or one file, into a state in which everything in it can be read.

    In a folder, unfinished ``.part`` files and damaged episodes go to ``quarantine/`` with a note, what can be salvaged
    of them to ``salvaged/``, and the index is written anew; what a running process is writing is left alone. A file of
    such a folder stands for the folder. A file that lies elsewhere stays there, and is salvaged next to itself as
    ``<name>.recovered.mcap``.
    """
    path = Path(path)
    if path.is_file() and path.resolve().parent.name in KINDS and (path.resolve().parents[1] / INDEX).exists():
        path = path.resolve().parents[1]
    if path.is_file():
        return [recover_episode(path, path.with_name(f"{_stem(path)}.recovered.mcap"))]
    folder = DatasetFolder(path)
    found = [_recover_in(folder, file, "was not finished") for file in folder.parts() if not is_being_written(file)]
    for file in (*folder.files(DEMOS), *folder.files(FAILURES)):
        try:
            read_episode(file)
        except DemoError as error:
            found.append(_recover_in(folder, file, str(error)))
    _reindex(folder)
    return found


def _recover_in(folder: DatasetFolder, file: Path, problem: str) -> Recovered:
    """Set one file of a folder aside and salvage what it holds."""
    aside = folder.quarantine(file, problem)
    try:
        return recover_episode(aside, folder.file(_stem(file), SALVAGED))
    except DemoError as error:
        return Recovered(aside, aside, 0, str(error))


def _reindex(folder: DatasetFolder) -> None:
    """Write the index anew, even if the old one is damaged."""
    try:
        spec = folder.spec()
    except DemoError as error:
        folder.quarantine(folder.path / INDEX, str(error))
        spec = None
    for file in folder.files():
        spec = spec or read_head(file, scan(file)).layout.spec
    if spec is not None:
        folder.write_index(spec, {file.stem: sha256_of(file) for file in folder.files()})


def _salvage(source: Path, contents: Contents, form: Form) -> tuple[Messages, bool, Mapping[str, Any]]:
    """Return the messages that are left, of which the last is the end, whether it succeeds, and what it is made of."""
    report = Report(source)
    if OUTCOME in contents.metadata:  # only the file's own end is lost
        outcome = read_outcome(source, contents)
        return form.read(report, contents, outcome.steps), outcome.success, outcome.made_of
    messages = form.read_whole_steps(report, contents)
    rows = messages.rows
    if len(rows) < 2:
        raise DemoError(source, "holds fewer than two complete steps; nothing can be salvaged.", got=len(rows))
    rows["truncated"][-2] = not rows["terminated"][-2]
    return messages, False, {}


def _stem(file: Path) -> str:
    return file.name.removesuffix(".part").removesuffix(".mcap")
