"""Help texts, read from the commands' dataclasses and from those of what is chosen."""

import textwrap
from collections.abc import Iterable
from importlib import metadata

from aerial_il.cli import commands
from aerial_il.cli.commands import Command
from aerial_il.cli.known import known, of_choice
from aerial_il.core import presets, registry
from aerial_il.core.composition import base_of
from aerial_il.core.schema import FROM, Key, options

_ORDER = (
    "demo", "list", "view", "collect", "segment", "generate", "browse", "card", "judge", "merge", "split", "filter",
    "relabel", "delete", "undo", "prefer", "train", "evaluate", "export", "fly", "simulate", "report", "compare",
    "leaderboard", "replay", "validate", "recover", "convert", "publish",
)  # fmt: skip
_WIDTH, _COLUMNS = 34, 120


def version() -> str:
    return f"aerial-il {metadata.version('aerial-il')}"


def overview() -> str:
    """Return what ``aerial-il --help`` prints."""
    lines = [f"  {name:<10} {commands.find(name).summary}" for name in ordered_names()]
    return "\n".join(
        [
            "Imitation learning on aerial manipulators: fly, record, learn, evaluate.",
            "",
            "Usage: aerial-il COMMAND key=value ...",
            "",
            *lines,
            "",
            "aerial-il COMMAND --help   its keys with defaults and meanings, and an example",
            "aerial-il train policy=act algorithm=dagger --help   those of what is chosen",
            "aerial-il COMMAND -m ...   one run for each combination: seed=0,1,2 policy.chunk=10,20 launcher=processes",
            'eval "$(aerial-il completion bash)"   tab completion (zsh: completion zsh)',
        ]
    )


def of_command(command: Command, typed: Iterable[str] = ()) -> str:
    """Return what ``aerial-il COMMAND ... --help`` prints: the keys of the command, and of what is chosen."""
    said = dict(word.split("=", 1) for word in typed if "=" in word)
    names = {name: [value] for name, value in said.items() if value[:1] not in ("{", "")}
    there = known(command.settings, names, base=base_of(command.settings, said.get(FROM), said))
    choices = [key for key in there.values() if key.takes == "choice"]
    titles = {key.name: f"{key.name}={said.get(key.name, key.default)}" for key in choices}
    own = [key for key in there.values() if not any(key.name.startswith(f"{name}.") for name in titles)]
    sections = [command.doc, f"Usage: aerial-il {command.name} key=value ...", _table("Keys", own)]
    for name, title in titles.items():
        deeper = tuple(f"{other}." for other in titles if other.startswith(f"{name}."))
        inside = [key for each, key in there.items() if each.startswith(f"{name}.") and not each.startswith(deeper)]
        sections.append(_table(title, inside))
    if command.output:
        launcher = said.get("launcher", "serial")
        few = ", ".join(registry.names("launcher"))
        keys = [Key(f"launcher.{k.name}", k.default, k.meaning) for k in of_choice("launcher", launcher)]
        chosen = Key("launcher", launcher, f"how the jobs of a sweep are started: {few}")
        sections.append(_table("Sweeps (-m)", [chosen, *keys]))
    sections.append("Options: -m (sweep over comma-separated values), --cfg job (print the settings), --help")
    return "\n\n".join(section for section in sections if section)


def reference() -> str:
    """Return the help of every command as one Markdown page."""
    pages = [f"## aerial-il {name}\n\n```text\n{of_command(commands.find(name))}\n```" for name in ordered_names()]
    return "\n\n".join(["# Commands", f"```text\n{overview()}\n```", *pages])


def ordered_names() -> list[str]:
    """Return the commands in the order of the work, new ones at the end."""
    return sorted(commands.names(), key=lambda n: (_ORDER.index(n) if n in _ORDER else len(_ORDER), n))


def meaning_of(key: Key) -> str:
    """Return what a key means, and what may be said."""
    few = ""
    if key.takes == "choice" or key.kind in ("robot", "task"):
        few = f"one of: {', '.join(options(key.kind))}"
    elif key.takes == "place" and presets.names(key.name):
        few = f"or one of: {', '.join(presets.names(key.name))}"
    elif key.options and key.options != ("true", "false"):
        few = f"one of: {', '.join(key.options)}"
    return "; ".join(filter(None, (key.meaning.removesuffix("."), few)))


def _table(title: str, keys: list[Key]) -> str:
    rows = [(f"{key.name}={key.default or '(required)'}", meaning_of(key)) for key in keys]
    width = min(_WIDTH, max((len(left) for left, _ in rows), default=0))
    indent = " " * (width + 4)
    lines = (textwrap.fill(f"  {left:<{width}}  {right}", _COLUMNS, subsequent_indent=indent) for left, right in rows)
    return "\n".join([f"{title}:", *lines]) if rows else ""
