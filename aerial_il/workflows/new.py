"""A working start for something of one's own: a task, a robot, a disturbance, a policy, an algorithm, …."""

import keyword
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from aerial_il.core.errors import InvalidValueError

Kind = Literal["task", "robot", "disturbance", "sensor", "controller", "format", "policy", "algorithm", "study"]
KINDS: tuple[str, ...] = get_args(Kind)
PAGES = (
    {"task": "docs/writing_a_task.md"}
    | {kind: f"docs/adding.md#{'an' if kind == 'algorithm' else 'a'}-{kind}" for kind in KINDS[1:]}
    | {"format": "docs/adding.md#a-dataset-format"}
)
TRY = {
    "task": ["evaluate", "policy=expert", "robot=fa_hexa_arm4", "task=NAME", "episodes=20", "out=runs/NAME"],
    "robot": ["evaluate", "policy=expert", "robot=NAME", "task=reach", "episodes=20", "out=runs/NAME"],
    "disturbance": ["evaluate", "policy=expert", "robot=quad", "task=hover", "tier=calm+NAME", "out=runs/NAME"],
    "sensor": ["list", "json=true"],
    "controller": ["evaluate", "policy=expert", "robot=quad", "task=hover", "controller=NAME", "out=runs/NAME"],
    "format": ["convert", "datasets/reach", "format=NAME"],
    "study": ["bench", "NAME"],
    "policy": ["train", "policy=NAME", "dataset=datasets/reach", "run=runs/NAME"],
    "algorithm": ["train", "algorithm=NAME", "policy=squashed_gaussian", "dataset=datasets/reach", "run=runs/NAME"],
}
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True, kw_only=True)
class New:
    """What is written, and where.

    Attributes:
        kind: kind to write.
        name: its name: small letters, digits and underscores.
        into: checkout to write into (null: the one that this program runs from).
    """

    kind: Kind
    name: str
    into: str | None = None

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or keyword.iskeyword(self.name):
            hint = "Take small letters, digits and underscores, 40 at most, e.g. stack_cubes."
            raise InvalidValueError(f"name={self.name} cannot be the name of a Python file. {hint}")


@dataclass(frozen=True)
class Started:
    """The files that were written, the page that explains them, and the words of a command to try."""

    files: tuple[Path, ...]
    page: str
    words: tuple[str, ...]


def new(settings: New) -> Started:
    """Write the files.

    Raises:
        InvalidValueError: the name is taken, or a file is there already.
    """
    from aerial_il.core.schema import options
    from aerial_il.workflows.starts import start

    if settings.name in options(settings.kind):
        raise InvalidValueError(f"A {settings.kind} named {settings.name} already exists. See: aerial-il list")
    top = Path(settings.into) if settings.into is not None else _checkout()
    files = {top / path: text for path, text in start(settings.kind, settings.name).items()}
    for file in files:
        if file.exists():
            raise InvalidValueError(f"{file} already exists, and is left unchanged. Choose another name=...")
    for file, text in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    words = tuple(word.replace("NAME", settings.name) for word in TRY[settings.kind])
    return Started(tuple(files), PAGES[settings.kind], words)


def _checkout() -> Path:
    """Return the checkout that the package lies in."""
    top = Path(__file__).resolve().parents[2]
    if not (top / "pyproject.toml").is_file():
        hint = "Clone the repository, run make setup there, and call its .venv/bin/aerial-il; or set into=CHECKOUT."
        raise InvalidValueError(f"{top} is an installed package, which an update would replace. {hint}")
    return top
