"""Write a working start for a task, a robot, a policy, an algorithm or a study of your own.

The registries find it by its name: list, help, completion and the contract tests include it at once. docs/adding.md and
docs/writing_a_task.md explain each line.

Example: aerial-il new task stack_cubes
Example: aerial-il new policy my_network
"""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import MISSING, check_choices, key
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.core.errors import InvalidValueError

KINDS = ("task", "robot", "policy", "algorithm", "study")
PAGES = {"task": "docs/writing_a_task.md"} | {
    kind: f"docs/adding.md#{'an' if kind == 'algorithm' else 'a'}-{kind}" for kind in KINDS[1:]
}
TRY = {
    "task": ["evaluate", "policy=expert", "robot=fa_hexa_arm4", "task=NAME", "episodes=20", "out=runs/NAME"],
    "robot": ["evaluate", "policy=expert", "robot=NAME", "task=reach", "episodes=20", "out=runs/NAME"],
    "policy": ["train", "policy=NAME", "dataset=datasets/reach", "run=runs/NAME"],
    "algorithm": ["train", "algorithm=NAME", "policy=squashed_gaussian", "dataset=datasets/reach", "run=runs/NAME"],
    "study": ["bench", "NAME"],
}
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass
class Config:
    kind: str = key(MISSING, "kind to write", choices=KINDS, position=0)
    name: str = key(MISSING, "its name: small letters, digits and underscores", position=1)
    into: str | None = key(None, "checkout to write into (null: the one that this program runs from)")

    def __post_init__(self) -> None:
        check_choices(self)
        if not _NAME.fullmatch(self.name) or keyword.iskeyword(self.name):
            hint = "Take small letters, digits and underscores, 40 at most, e.g. stack_cubes."
            raise InvalidValueError(f"name={self.name} cannot be the name of a Python file. {hint}")


def run(config: Config) -> None:
    """Write the files, and say what comes next."""
    from aerial_il.cli.configuration import groups
    from aerial_il.cli.starts import start

    if config.name in groups.options(config.kind):
        raise InvalidValueError(f"A {config.kind} named {config.name} already exists. See: aerial-il list")
    top = Path(config.into) if config.into is not None else _checkout()
    files = {top / path: text for path, text in start(config.kind, config.name).items()}
    for file in files:
        if file.exists():
            raise InvalidValueError(f"{file} already exists, and is left unchanged. Choose another name=...")
    for file, text in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        print(f"Written: {file}")
    print(f"Explained in: {PAGES[config.kind]}")
    print(f"Next: {command_line(word.replace('NAME', config.name) for word in TRY[config.kind])}")


def _checkout() -> Path:
    """Return the checkout that the package lies in."""
    top = Path(__file__).resolve().parents[4]
    if not (top / "pyproject.toml").is_file():
        hint = "Clone the repository, run make setup there, and call its .venv/bin/aerial-il; or set into=CHECKOUT."
        raise InvalidValueError(f"{top} is an installed package, which an update would replace. {hint}")
    return top
