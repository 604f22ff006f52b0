"""Words in the grammar of Hydra become the settings of a command; its sweeps become points."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from aerial_il.cli import commands, words
from aerial_il.cli.commands import Command
from aerial_il.core.composition import base_of, build, plain
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.schema import FROM, keys
from aerial_il.workflows.spelling import literal


def perform(name: str, overrides: Sequence[str]) -> None:
    """Run the command ``name`` with words that are as Hydra reads them, such as :func:`points` returns."""
    command = commands.find(name)
    command.run(settings_of(command, overrides))


def compose(command: Command, typed: list[str]) -> Any:
    """Return the settings that typed words lead to, without running anything."""
    read = words.read(command, typed)
    return settings_of(command, read.overrides, read.earlier)


def settings_of(command: Command, overrides: Sequence[str], earlier: Any = None) -> Any:
    """Return the settings that overrides lead to.

    Args:
        earlier: the settings that ``from`` names, where they have been read.

    Raises:
        UnknownNameError: there is no such key or choice. InvalidValueError: a value does not fit, or one is missing.
    """
    try:
        if earlier is None:
            parsed = _parsed(overrides)
            place = next((each.value() for each in parsed if each.key_or_group == FROM), None)
            earlier = base_of(command.settings, getattr(place, "text", place), {each.key_or_group for each in parsed})
        return build(command.settings, said(command.settings, overrides, earlier), base=earlier)
    except UnknownNameError as error:
        if error.kind != "key":
            raise
        raise UnknownNameError(error.kind, error.value, error.choices, command.hint) from error
    except InvalidValueError as error:
        needs = f"{command.settings.__name__.lower()} needs "
        if not str(error).startswith(needs):
            raise
        raise InvalidValueError(f"{command.name} needs {str(error).removeprefix(needs)} {command.hint}") from error


def said(settings: type, overrides: Sequence[str], earlier: Any = None) -> dict[str, Any]:
    """Return what overrides say as nested plain values; they may refer to each other and to defaults, ``${seed}``.

    Args:
        earlier: settings that stand for the defaults.
    """
    from hydra.core.utils import setup_globals
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    values, parsed = dict[str, Any](), _parsed(overrides)
    setup_globals()  # for ${now:...}
    cfg = OmegaConf.create(_node(settings, earlier))
    try:
        for word, each in zip(overrides, parsed, strict=True):
            if each.is_sweep_override():
                raise InvalidValueError(f"{word} are several values: add -m to sweep over them.")
            OmegaConf.update(cfg, each.key_or_group, each.value(), merge=True, force_add=True)
        for name in (each.key_or_group for each in parsed):
            value, place = OmegaConf.select(cfg, name), values
            *path, last = name.split(".")
            for step in path:
                place = place.setdefault(step, {})
            place[last] = OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value
    except (OmegaConfBaseException, AttributeError, TypeError) as error:
        raise InvalidValueError(f"{' '.join(overrides)} does not go together: {_first_line(error)}") from error
    return values


def points(command: Command, overrides: Sequence[str]) -> list[tuple[tuple[str, ...], str]]:
    """Return, for each point of a sweep, its words as Hydra reads them and the folder of its own."""
    target, parsed = command.output, _parsed(overrides)
    if target in (each.key_or_group for each in parsed if each.is_sweep_override()):
        raise InvalidValueError(f"{target} cannot be swept: each job gets a folder of its own below {target}=FOLDER.")
    top = output_folder(command, overrides) if target else "multirun"
    free = [(word, each) for word, each in zip(overrides, parsed, strict=True) if each.key_or_group != target]
    ways = [_ways(word, each) for word, each in free]
    swept = [place for place, (_, each) in enumerate(free) if each.is_sweep_override()]
    jobs, named = [], set[str]()
    for number, point in enumerate(itertools.product(*ways)):
        name = ",".join(_shown(point[place]) for place in swept) or str(number)
        name = f"{name},{number}" if name in named else name
        named.add(name)
        folder = str(Path(top) / name)
        jobs.append(((*point, *([f"{target}={literal(folder)}"] if target else [])), folder))
    return jobs


def space(command: Command, overrides: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    """Return key -> Hydra's sweep over its values, and the other words as Hydra reads them, the output's left out.

    Raises:
        InvalidValueError: nothing is swept, or a word cannot be read.
    """
    parsed = _parsed(overrides)
    swept = {each.key_or_group: each.value() for each in parsed if each.is_sweep_override()}
    if not swept:
        raise InvalidValueError(
            "There is nothing to search: give a key an interval, e.g. 'algorithm.lr=interval(0.0001,0.01)'."
        )
    fixed = [word for word, each in zip(overrides, parsed, strict=True) if not each.is_sweep_override()]
    return swept, [word for word in fixed if not word.startswith(f"{command.output}=")]


def output_folder(command: Command, overrides: Sequence[str]) -> str:
    """Return where the results go that ``overrides`` ask for."""
    own = said(command.settings, [word for word in overrides if word.startswith(f"{command.output}=")])
    folder = own.get(command.output, getattr(command.settings, command.output, None))
    if not isinstance(folder, str):
        raise InvalidValueError(f"{command.name} needs {command.output}=... {command.hint}")
    return folder


def _ways(word: str, parsed: Any) -> list[str]:
    from hydra.core.override_parser.types import ChoiceSweep, RangeSweep

    if not parsed.is_sweep_override():
        return [word]
    if not isinstance(parsed.value(), ChoiceSweep | RangeSweep):
        raise InvalidValueError(
            f"{word}: a sweep takes A,B, choice(A,B) or range(A,B,STEP); a search takes intervals too."
        )
    return [f"{parsed.key_or_group}={value}" for value in parsed.sweep_string_iterator()]


def _shown(word: str) -> str:
    """Return a swept word as it stands in the name of a folder, which is one and not a path."""
    from hydra.core.override_parser.types import QuotedString

    (parsed,) = _parsed([word])
    value = parsed.value()
    text = value.text if isinstance(value, QuotedString) else str(value)
    return f"{parsed.key_or_group.removesuffix('.name')}={text}".replace("'", "").replace("/", "-")


def _parsed(overrides: Iterable[str]) -> list[Any]:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    parser, parsed = OverridesParser.create(), []
    for word in overrides:
        try:
            parsed.append(parser.parse_override(f"++{word}"))
        except HydraException as error:
            raise InvalidValueError(
                f"{word} cannot be read: close its brackets and quotes; text with signs of its own stands in quotes "
                f"that the shell leaves, \"{word.partition('=')[0]}='...'\"."
            ) from error
    return parsed


def _node(settings: type, base: Any) -> dict[str, Any]:
    """Return the defaults of settings, for values to refer to; a choice is a mapping with its name."""
    if base is not None:
        return plain(base)
    values = {f.name: f.default for f in fields(settings) if f.default is not MISSING}
    groups = {name: plain(value) for name, value in values.items() if is_dataclass(value)}
    choices = {key.name: {"name": key.default} for key in keys(settings) if key.takes == "choice"}
    return values | groups | choices


def _first_line(error: Exception) -> str:
    return str(error.__cause__ or error).strip().partition("\n")[0]
