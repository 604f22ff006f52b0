"""Tab completion: commands, keys, groups and their values, paths left to the shell."""

from __future__ import annotations

from dataclasses import fields

from aerial_il.cli import commands, launchers
from aerial_il.cli.configuration import groups, keys
from aerial_il.cli.configuration.flags import FLAGS
from aerial_il.cli.configuration.overrides import known_keys
from aerial_il.core.errors import UnknownNameError

ACTION = "action"
CELL = {"robot": "task", "task": "robot"}  # what each must fit

# COMP_WORDBREAKS splits at "=": the word under the cursor is taken from the line itself, and only what
# stands behind the last "=" is handed back.
_BASH = r"""_aerial_il() {
    local line="${COMP_LINE:0:COMP_POINT}" word
    word="${line##* }"
    local IFS=$'\n'
    COMPREPLY=($(aerial-il _complete ${line// /$'\n'} ${line:+$([[ "$line" == *" " ]] && echo "''")} 2>/dev/null))
    if [[ "$word" == *=* ]]; then
        if [ ${#COMPREPLY[@]} -eq 0 ]; then COMPREPLY=($(compgen -f -- "${word##*=}")); compopt -o filenames 2>/dev/null
        else COMPREPLY=("${COMPREPLY[@]#"${word%%=*}="}"); fi
    fi
    [[ ${#COMPREPLY[@]} -eq 1 && "${COMPREPLY[0]}" == *= ]] && compopt -o nospace 2>/dev/null
    [[ ${#COMPREPLY[@]} -gt 1 ]] && compopt -o nospace 2>/dev/null
    return 0
}
complete -F _aerial_il aerial-il"""
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
    words = [word for word in line if word not in ("", "''")]
    last = "" if not line or line[-1] in ("", "''") else line[-1]
    before = words[1:-1] if last else words[1:]
    if not before:
        every = [*commands.names(), "completion", "help", "--help", "--version"]
        return [name for name in every if name.startswith(last)]
    if before[0] not in commands.names():
        return []
    return [word for word in _words(before[0], before[1:], last) if word.startswith(last)]


def _words(name: str, typed: list[str], last: str) -> list[str]:
    command = commands.find(name)
    chosen = dict(command.choices)
    if keys.output_key(command.config):
        chosen["launcher"] = launchers.USUAL
    chosen |= {k: v for k, _, v in (word.partition("=") for word in typed) if k in chosen}
    key, equals, _ = last.partition("=")
    if not equals:
        given = {word.partition("=")[0] for word in typed}
        inner = [k for k in known_keys(command, chosen) if k not in given and ("." not in k or "." in last)]
        bare = [option for k in keys.positional(command.config)[:1] if k in chosen for option in groups.options(k)]
        return bare + [f"{k}=" for k in inner] + [flag for flag in (*FLAGS, "--help") if last.startswith("-")]
    field = next((f for f in fields(command.config) if f.name == key), None)
    if key in chosen:
        return [f"{key}={option}" for option in _fitting(key, typed)]
    if field is not None and key == ACTION:
        return [f"{key}={level}" for level in _levels()]
    if field is None:
        return []
    if keys.type_text(command.config, field) == "true or false":
        return [f"{key}=true", f"{key}=false"]
    return [f"{key}={choice}" for choice in field.metadata.get("choices", ())]


def _fitting(group: str, typed: list[str]) -> list[str]:
    """Return what may be chosen in a group; of robots and tasks, only those that fit the other one that was typed.

    Robots say themselves what they decline: only then is the suite imported, half a second.
    """
    said = dict(word.split("=", 1) for word in typed if "=" in word)
    options = list(groups.options(group))
    if group not in CELL or said.get(CELL[group]) not in groups.options(CELL[group]):
        return options
    from aerial_il.suite import tasks

    cells: list[dict[str, str]] = [{"robot": robot, "task": task} for robot, task in tasks.cells()]
    fitting = {cell[group] for cell in cells if cell[CELL[group]] == said[CELL[group]]}
    return [option for option in options if option in fitting]


def _levels() -> list[str]:
    from aerial_il.control.actions import ActionLevel

    return [level.label for level in ActionLevel]
