"""Help texts, made from the commands' dataclasses and the files of ``conf/``; nothing heavy is imported for them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from importlib import metadata
from typing import get_type_hints

from aerial_il.cli import commands, launchers
from aerial_il.cli.commands import Command
from aerial_il.cli.configuration import groups, keys

_ORDER = (
    "demo",
    "list",
    "view",
    "collect",
    "train",
    "evaluate",
    "report",
    "compare",
    "replay",
    "validate",
    "recover",
    "convert",
)


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
            "aerial-il COMMAND --help   its keys, groups and an example",
            "aerial-il COMMAND -m ...   one run for each combination: seed=0,1,2 policy.chunk=10,20 launcher=processes",
            'eval "$(aerial-il completion bash)"   tab completion (zsh: completion zsh)',
        ]
    )


def of_command(command: Command) -> str:
    """Return what ``aerial-il COMMAND --help`` prints."""
    sections = [command.doc, f"Usage: aerial-il {command.name} key=value ...", _keys(command), _groups(command)]
    sections.append(_launching(command))
    sections.append("Options: -m (sweep over comma-separated values), --cfg job (print the configuration), --help")
    return "\n\n".join(section for section in sections if section)


def _launching(command: Command) -> str:
    """Return how a sweep's jobs can be launched, of a command whose jobs get folders of their own."""
    if not keys.output_key(command.config):
        return ""
    usual = groups.read_option("launcher", launchers.USUAL)
    return _table(
        "Sweeps (-m)", [(f"launcher={launchers.USUAL}", _group_help("launcher", "how its jobs are started", usual))]
    )


def reference() -> str:
    """Return the help of every command as one Markdown page."""
    pages = [f"## aerial-il {name}\n\n```text\n{of_command(commands.find(name))}\n```" for name in ordered_names()]
    return "\n\n".join(["# Commands", f"```text\n{overview()}\n```", *pages])


def ordered_names() -> list[str]:
    """Return the commands in the order of the work, new ones at the end."""
    return sorted(commands.names(), key=lambda n: (_ORDER.index(n) if n in _ORDER else len(_ORDER), n))


def _keys(command: Command) -> str:
    rows = []
    for field in fields(command.config):
        if not keys.is_group(field):
            default = keys.default_text(field) or "(required)"
            rows.append((f"{field.name}={default}", field.metadata.get("help", "")))
    return _table("Keys", rows)


def _groups(command: Command) -> str:
    chosen = command.choices
    helps = {f.name: f.metadata.get("help", "") for f in fields(command.config)}
    hints = get_type_hints(command.config)
    rows = []
    for name in [*(f.name for f in fields(command.config) if keys.is_group(f)), *(g for g in chosen if g not in helps)]:
        if name not in chosen and is_dataclass(hints.get(name)):
            rows.append((f"{name}=PATH", helps[name]))
            continue
        content = groups.read_option(name, str(chosen[name])) if chosen.get(name) else {}
        rows.append((f"{name}={chosen[name] or 'null'}", _group_help(name, helps.get(name), content)))
    return _table("Groups (GROUP=CHOICE; GROUP.KEY=VALUE changes one value)", rows)


def _group_help(name: str, text: str | None, content: dict[str, object]) -> str:
    inner = ", ".join(leaf for leaf in groups.leaf_keys(content) if leaf not in ("", "name", "defaults"))
    of = f"one of: {', '.join(groups.options(name)) or 'none yet'}"
    if text is None:  # the group has no key of its own: its files set the command's
        return "; ".join(filter(None, ("a set of values", of, inner and f"sets: {inner}")))
    return "; ".join(filter(None, (text, of, inner and f"keys: {inner}")))


def _table(title: str, rows: list[tuple[str, str]]) -> str:
    width = min(32, max((len(left) for left, _ in rows), default=0))
    return "\n".join([f"{title}:", *(f"  {left:<{width}}  {right}".rstrip() for left, right in rows)]) if rows else ""
