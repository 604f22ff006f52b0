"""Pages of the commands for the site, from what help and completion read: dataclasses and the files of ``conf/``."""

from __future__ import annotations

import re
from dataclasses import fields

from aerial_il.cli import commands
from aerial_il.cli.commands import Command
from aerial_il.cli.configuration import groups, keys
from aerial_il.cli.help import ordered_names

EXAMPLE = re.compile(r"^Example: (.*)$", re.MULTILINE)
INTRODUCTION = """\
# Commands

`aerial-il COMMAND key=value ...`: every command with its keys, from the code that reads them. `aerial-il COMMAND
--help` says the same, `aerial-il COMMAND -m seed=0,1,2 policy.chunk=10,20` makes one run of each combination, and
`eval "$(aerial-il completion bash)"` completes commands, keys and values."""


def pages() -> dict[str, str]:
    """Return path on the site -> text: one page for each command, one for each group of choices, and a list."""
    found = [commands.find(name) for name in ordered_names()]
    rows = [f"| [`{command.name}`]({command.name}.md) | {_prose(command.summary)} |" for command in found]
    groups_row = "What may be chosen where a key is a group: [groups](groups.md)."
    index = "\n".join([INTRODUCTION, "", "| command | |", "|---|---|", *rows, "", groups_row, ""])
    of_commands = {f"commands/{command.name}.md": _page(command) for command in found}
    return {"commands/index.md": index, "commands/groups.md": _groups_page(), **of_commands}


def _page(command: Command) -> str:
    examples = "\n".join(EXAMPLE.findall(command.doc))
    text = EXAMPLE.sub("", command.doc).strip()
    parts = [f"# aerial-il {command.name}", _prose(text), f"```sh\n{examples}\n```" if examples else "", _keys(command)]
    return "\n\n".join(part for part in [*parts, _groups(command)] if part) + "\n"


def _keys(command: Command) -> str:
    rows = []
    for field in fields(command.config):
        if not keys.is_group(field):
            choices = ", ".join(f"`{choice}`" for choice in field.metadata.get("choices", ()))
            told = _prose(field.metadata.get("help", ""))
            rows.append((f"`{field.name}`", _value(keys.default_text(field)), "; ".join(filter(None, (told, choices)))))
    return f"## Keys\n\n{_table(('key', 'default', ''), rows)}" if rows else ""


def _groups(command: Command) -> str:
    helps = {field.name: field.metadata.get("help", "") for field in fields(command.config)}
    chosen = {name: choice for name, choice in command.choices.items() if name in groups.groups()}
    rows = [
        (f"[`{name}`](groups.md#{name})", f"`{choice or 'null'}`", _prose(helps.get(name, "a set of values")))
        for name, choice in chosen.items()
    ]
    return f"## Groups\n\n{_table(('group', 'default', ''), rows)}" if rows else ""


def _groups_page() -> str:
    head = (
        "# Groups of choices\n\nA group is a key whose value is one of several names: `policy=act` chooses, "
        "`policy.chunk=20` changes one value of the choice."
    )
    return "\n\n".join([head, *(_group(name) for name in groups.groups())]) + "\n"


def _group(name: str) -> str:
    rows = []
    for option in groups.options(name):
        content = groups.read_option(name, option)
        leaves = [leaf for leaf in groups.leaf_keys(content) if leaf not in ("", "name", "defaults", "_target_")]
        rows.append((f"`{option}`", ", ".join(f"`{leaf}`" for leaf in leaves) or "–"))
    return f"## {name}\n\n{_table(('choice', 'its keys'), rows)}"


def _value(text: str) -> str:
    return f"`{text}`" if text else "required"


def _prose(text: str) -> str:
    """Return a docstring's words as Markdown, with nothing in them that Markdown would take for its own."""
    parts = re.split(r"(``?[^`]+``?)", text)
    return "".join(
        f"`{part.strip('`')}`" if part.startswith("`") else re.sub(r"([*_|<>\[\]])", r"\\\1", part) for part in parts
    )


def _table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    lines += [f"| {' | '.join(cell.replace(chr(10), ' ') for cell in row)} |" for row in rows]
    return "\n".join(lines)
