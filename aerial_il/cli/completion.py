"""Tab completion: commands, keys, groups and their values, paths left to the shell."""

from pathlib import Path

from aerial_il.cli import commands, words
from aerial_il.cli.known import known, of_choice
from aerial_il.core import presets
from aerial_il.core.errors import UnknownNameError
from aerial_il.core.schema import Key, options

ACTION = "action"
CELL = {"robot": "task", "task": "robot"}  # what each must fit

_BASH = Path(__file__).with_suffix(".bash").read_text(encoding="utf-8").rstrip()
_SHELLS = {"bash": _BASH, "zsh": "autoload -U +X bashcompinit && bashcompinit\n" + _BASH}


def script(shell: str) -> str:
    """Return what ``eval "$(aerial-il completion SHELL)"`` evaluates."""
    if shell not in _SHELLS:
        raise UnknownNameError("shell", shell, _SHELLS)
    return _SHELLS[shell]


def candidates(line: list[str]) -> list[str]:
    """Return the possible forms of the last word.

    Args:
        line: the words of the command line so far, ``aerial-il`` first; the last one may be unfinished or ``''``.
    """
    typed = [word for word in line if word not in ("", "''")]
    last = "" if not line or line[-1] in ("", "''") else line[-1]
    before = typed[1:-1] if last else typed[1:]
    if not before:
        every = [*commands.names(), "completion", "help", "--help", "--version"]
        return [name for name in every if name.startswith(last)]
    if before[0] not in commands.names():
        return []
    return [word for word in _words(before[0], before[1:], last) if word.startswith(last)]


def _words(name: str, typed: list[str], last: str) -> list[str]:
    command = commands.find(name)
    said = {key: value for key, _, value in (word.partition("=") for word in typed)}
    there = known(command.settings, {key: [value] for key, value in said.items() if value and value[0] not in "[{"})
    if command.output:
        launcher = said.get("launcher", "serial")
        there["launcher"] = Key("launcher", launcher, "", "choice", kind="launcher")
        there |= {f"launcher.{key.name}": key for key in of_choice("launcher", launcher)}
    key, equals, _ = last.partition("=")
    if not equals:
        own = {each.partition(".")[0] if "." not in last else each for each in there} - said.keys()
        few = [option for each in command.bare[:1] if each in there for option in _options(there[each])]
        flags = [flag for flag in words.FLAGS if last.startswith("-")]
        return few + [f"{each}=" for each in sorted(own)] + flags
    if key in CELL:
        return [f"{key}={option}" for option in _fitting(key, said)]
    if key == ACTION:
        return [f"{key}={level}" for level in _levels()]
    return [f"{key}={option}" for option in (_options(there[key]) if key in there else ())]


def _options(key: Key) -> tuple[str, ...]:
    """Return what may be said of a key, where it is one of a few; nothing where it is a place or a number."""
    if key.takes == "place":
        return presets.names(key.name)
    return options(key.kind) if key.kind else key.options


def _fitting(kind: str, said: dict[str, str]) -> list[str]:
    """Return robots or tasks; only those that fit the other one that was typed.

    Robots say themselves what they decline: only then is the suite imported, half a second.
    """
    few, other = list(options(kind)), CELL[kind]
    if said.get(other) not in options(other):
        return few
    from aerial_il.suite import tasks

    cells: list[dict[str, str]] = [{"robot": robot, "task": task} for robot, task in tasks.cells()]
    fitting = {cell[kind] for cell in cells if cell[other] == said[other]}
    return [option for option in few if option in fitting]


def _levels() -> list[str]:
    from aerial_il.control.actions import ActionLevel

    return [level.label for level in ActionLevel]
