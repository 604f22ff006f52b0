"""The mesh files that a model refers to, looked for in one folder and nowhere else."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from aerial_il.robots.parts.described.error import ModelFileError

READABLE = (".stl", ".obj", ".msh")  # by MuJoCo
MAX_BYTES = 32 << 20
_SCHEME = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]+)://")

# Stands for a mesh that is not there until it is known whether something collides with it.
PLACEHOLDER = "v 0 0 0\nv .001 0 0\nv 0 .001 0\nv 0 0 .001\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@dataclass
class MeshFiles:
    """Contents of meshes under names of our own, so that MuJoCo opens no file.

    Attributes:
        source: the model file. folder: where meshes may lie, below it too.
        contents: name -> bytes, as MuJoCo takes them. missing: mesh name -> why it could not be read.
    """

    source: Path
    folder: Path
    contents: dict[str, bytes] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, reference: str) -> str:
        """Read a mesh; return the name of the file under which MuJoCo finds it.

        Args:
            name: of the mesh. reference: as the model file says it, e.g. ``package://my_arm/meshes/link.stl``.

        Raises:
            ModelFileError: the reference points out of the folder, or to something that is no file of this machine.
        """
        path = self._find(reference)
        suffix = Path(reference).suffix.lower()
        if suffix not in READABLE:
            self.missing[name] = f"{reference} is no {', '.join(READABLE)} file; convert it, e.g. with Blender"
        elif path is None:
            self.missing[name] = (
                f"{reference} was looked for in {self._places(reference)} and is not there; copy it there, or name the "
                "folder that holds the meshes, or the folder of their package: meshes=..."
            )
        elif path.stat().st_size > MAX_BYTES:
            self.missing[name] = f"{reference} has {path.stat().st_size} bytes, and {MAX_BYTES} is the most"
        file = f"mesh_{len(self.contents)}" + (".obj" if name in self.missing else suffix)
        self.contents[file] = PLACEHOLDER.encode() if name in self.missing or path is None else path.read_bytes()
        return file

    def _find(self, reference: str) -> Path | None:
        return next((place for place in self._candidates(reference) if place.is_file()), None)

    def _candidates(self, reference: str) -> list[Path]:
        """Where a mesh may lie: a package is the folder itself, or a folder of its name."""
        rest, scheme = reference.replace("\\", "/"), None
        if found := _SCHEME.match(rest):
            scheme, rest = found["scheme"], rest[found.end() :]
        if scheme not in (None, "package", "model", "file"):
            raise ModelFileError(self.source, f"mesh {reference!r} is not on this machine; copy it to {self.folder}.")
        inside = [rest, rest.split("/", 1)[-1]] if scheme in ("package", "model") else [rest]
        places = [(self.folder / name).resolve() for name in inside]
        outside = [place for place in places if not place.is_relative_to(self.folder.resolve())]
        if outside:
            raise ModelFileError(
                self.source,
                f"mesh {reference!r} points out of {self.folder}, and nothing outside is read. Copy it there, or name "
                "the folder that holds the meshes: meshes=....",
            )
        return places

    def _places(self, reference: str) -> str:
        return " and ".join(str(place) for place in self._candidates(reference))
