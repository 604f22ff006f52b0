"""The dataset folder: where finished, failed, doubtful and discarded episodes lie, and an index of them.

``dataset.yaml`` is an index and can be rebuilt; the files in ``demos/`` and ``failures/`` are the truth.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from aerial_il.core.bounded import read_yaml
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.files import open_own, sha256_of, sync_folder, write_atomic
from aerial_il.core.places import claim_folder
from aerial_il.core.specs import EnvSpec
from aerial_il.data.recording.writer import storing

INDEX, LOG, LINEAGE = "dataset.yaml", "recordings.jsonl", "lineage.json"
DEMOS, FAILURES, SALVAGED = "demos", "failures", "salvaged"
KINDS = (DEMOS, FAILURES)


class DatasetFolder:
    """A folder of recorded episodes of one environment.

    Args:
        path: the folder; it need not exist yet.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def file(self, uid: str, kind: str = DEMOS) -> Path:
        """Return where an episode lies; its name, which may come from a file, is one of this folder."""
        if Path(uid).name != uid or "\0" in uid:
            raise DemoError(self.path, f"cannot hold an episode named {uid!r}.")
        return self.path / kind / f"{uid}.mcap"

    def find(self, uid: str) -> Path | None:
        """Return the file of a finished episode, wherever it lies, or None."""
        return next((file for kind in KINDS if (file := self.file(uid, kind)).exists()), None)

    def files(self, kind: str = DEMOS) -> list[Path]:
        """Return the finished episodes of a kind, by name."""
        return sorted((self.path / kind).glob("*.mcap"))

    def parts(self) -> list[Path]:
        """Return the files that a killed process left unfinished, or that are being written."""
        return sorted((self.path / DEMOS).glob("*.mcap.part"))

    def read_index(self) -> dict[str, Any]:
        """Return what ``dataset.yaml`` says, or an empty mapping where there is none."""
        path = self.path / INDEX
        try:
            index = read_yaml(path)
            EnvSpec.from_dict(index["spec"])
            if not all(isinstance(index[kind], dict) for kind in KINDS):
                raise InvalidValueError(f"{KINDS} must be mappings")
            return index
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError, KeyError) as error:
            hint = "It is only an index: remove it, and collecting or recovering writes it anew."
            raise DemoError(path, f"cannot be read ({error!r}).", hint=hint) from error

    def spec(self) -> EnvSpec | None:
        """Return the specification of the environment that the folder belongs to, or None for a new folder."""
        index = self.read_index()
        return EnvSpec.from_dict(index["spec"]) if index else None

    def claim(self, spec: EnvSpec) -> None:
        """Bind the folder to the environment of ``spec``.

        Raises:
            InvalidValueError: it holds episodes of another environment.
            StorageError: it cannot be written.
        """
        owner = self.spec()
        if owner is None:
            self.require_own()
            self.write_index(spec)
        elif differing := owner.differences(spec):
            raise InvalidValueError(
                f"{self.path} holds {owner.robot}/{owner.task} episodes of another environment: "
                f"{'; '.join(differing[:3])}. Choose another folder with out=PATH."
            )

    def require_own(self) -> None:
        """Refuse a folder with what was not written here.

        Raises:
            InvalidValueError: there is something of somebody else's.
        """
        if self.spec() is None:
            claim_folder(self.path, (LOG, LINEAGE, "*/*.mcap", "*/*.mcap.part"))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other processes from editing what lies here, or from putting a dataset together here.

        Raises:
            InvalidValueError: another process does so now.
        """
        handle = os.open(self.path, os.O_RDONLY)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InvalidValueError(f"{self.path} is being edited by another process: wait for it.") from None
            yield
        finally:
            os.close(handle)

    def write_index(
        self, spec: EnvSpec, written: Mapping[str, str] = MappingProxyType({}), *, leaving: Collection[str] = ()
    ) -> None:
        """List all finished episodes with their SHA-256.

        Args:
            spec: the environment.
            written: uid -> SHA-256 of what was just written; of others not listed yet the file is read.
            leaving: uids that are not to be listed, as their files are about to be changed or moved.
        """
        known = self.read_index()
        listed = {
            kind: {
                file.stem: written.get(file.stem) or known.get(kind, {}).get(file.stem) or sha256_of(file)
                for file in self.files(kind)
                if file.stem not in leaving
            }
            for kind in KINDS
        }
        head = {"schema": 1, "robot": spec.robot, "task": spec.task, "action": spec.action.level}
        tree = {**head, "spec": spec.to_dict(), **listed}
        with storing(self.path / INDEX):
            write_atomic(self.path / INDEX, yaml.dump(tree, Dumper=yaml.CSafeDumper, sort_keys=False))

    def keep_model(self, model_xml: str) -> Path:
        """Store a compiled scene once under ``models/``, for viewers; episodes carry their own copy."""
        path = self.path / "models" / f"{hashlib.sha256(model_xml.encode()).hexdigest()}.xml"
        if not path.exists():
            with storing(path):
                write_atomic(path, model_xml)
        return path

    def adopt(self, other: DatasetFolder) -> None:
        """Show the finished episodes of ``other`` here too: the same files where the disk allows, copies elsewhere."""
        for kind in KINDS:
            for file in other.files(kind):
                target = self.path / kind / file.name
                with storing(target):
                    target.parent.mkdir(parents=True, exist_ok=True)
                    link(file, target)

    def log(self, entry: Mapping[str, Any]) -> None:
        """Append a line to ``recordings.jsonl``, the place for what varies from run to run, such as wall time."""
        with storing(self.path / LOG), open_own(self.path / LOG) as file:
            file.write(json.dumps(entry).encode() + b"\n")

    def quarantine(self, file: Path, problem: str) -> Path:
        """Set a file aside that is unfinished or failed validation, with a note that says why."""
        target = self._move(file, "quarantine")
        with storing(target):
            write_atomic(target.with_name(target.name + ".txt"), f"{problem}\n")
        return target

    def trash(self, uid: str) -> Path:
        """Discard an episode; :meth:`restore` undoes it."""
        file = self.find(uid)
        if file is None:
            raise DemoError(
                self.path, f"has no episode {uid!r}.", hint=f"List them with: aerial-il info path={self.path}"
            )
        return self._move(file, f"trash/{file.parent.name}")

    def restore(self, uid: str) -> Path:
        """Bring a discarded episode back."""
        for kind in KINDS:
            if (file := self.path / "trash" / kind / f"{uid}.mcap").exists():
                return self._move(file, kind)
        raise DemoError(self.path / "trash", f"has no episode {uid!r}.")

    def _move(self, file: Path, kind: str) -> Path:
        target = self.path / kind / file.name
        with storing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, target)
            sync_folder(target.parent)
        return target


def link(source: Path, target: Path) -> None:
    """Make ``target``, unless it is there, another name of ``source``, or a copy of it on another disk."""
    aside = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    if target.exists():
        return
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, aside)
        os.replace(aside, target)
