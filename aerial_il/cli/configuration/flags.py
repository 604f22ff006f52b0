"""Words that begin with a hyphen: the few of Hydra's that a command takes, and what stands instead of the others."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from aerial_il.core.errors import InvalidValueError, UnknownNameError

FLAGS = ("-m", "--multirun", "--cfg", "--resolve")
TAKES_VALUE: Mapping[str, tuple[str, ...]] = {"--cfg": ("job", "hydra", "all")}
_SWEEPING = frozenset(("-m", "--multirun"))

_FILES = (
    "settings are read from the files that are shipped. Say what differs as key=value; a setting of yours that returns "
    "becomes a name with: aerial-il new policy NAME (or robot, task, algorithm)."
)
_SHOWN = (
    "to see the configuration: aerial-il {command} --cfg job (--cfg all: Hydra's own too; --resolve: values filled in)."
)
_INSTEAD: Mapping[str, str] = {  # Hydra's flags, and what is meant by them here; its short ones stand beside them
    "--config-dir": _FILES,
    "--config-path": _FILES,
    "--config-name": _FILES,
    "--info": f"{_SHOWN} The machine and what is installed: aerial-il doctor.",
    "--package": _SHOWN,
    "--run": "a command runs once unless -m asks for a sweep: leave it out.",
    "--shell-completion": 'eval "$(aerial-il completion bash)" (or zsh) completes words.',
    "--hydra-help": "keys and groups: aerial-il {command} --help.",
    "--version": "aerial-il --version.",
    "--experimental-rerun": "the same command again continues; what was typed is in a run's command.json.",
}
_SHORT: Mapping[str, str] = {
    "-cd": "--config-dir", "-cp": "--config-path", "-cn": "--config-name", "-i": "--info", "-p": "--package",
    "-r": "--run", "-sc": "--shell-completion", "-c": "--cfg",
}  # fmt: skip


def sweeps(flags: Collection[str]) -> bool:
    """Whether a flag asks for one run for each combination of values."""
    return not _SWEEPING.isdisjoint(flags)


def check_flag(command: str, word: str, after: str | None) -> None:
    """Refuse a flag that there is not, or a value that is none of the flag before it.

    Args:
        command: name of the command that is told. word: as typed. after: the flag before it, if there is one.

    Raises:
        UnknownNameError: neither a flag nor such a value. InvalidValueError: a flag of Hydra's that is not taken.
    """
    if after is not None and after in TAKES_VALUE:
        if word not in TAKES_VALUE[after]:
            raise UnknownNameError("--cfg", word, TAKES_VALUE[after], f"See: aerial-il {command} --help")
        return
    if word in FLAGS:
        return
    flag, _, value = word.partition("=")
    flag = _SHORT.get(flag, flag)
    if flag in TAKES_VALUE:  # -c job, --cfg=job
        raise InvalidValueError(f"{word} is written {flag} {value if value in TAKES_VALUE[flag] else 'job'}.")
    if flag in _INSTEAD:
        raise InvalidValueError(f"{word} is not taken: {_INSTEAD[flag].format(command=command)}")
    raise UnknownNameError("option", word, FLAGS, f"See: aerial-il {command} --help")


def check_last(word: str | None) -> None:
    """Refuse a flag at the end that needs a value."""
    if word is not None and word in TAKES_VALUE:
        raise InvalidValueError(f"{word} needs one of {', '.join(TAKES_VALUE[word])}.")
