"""Pages of the commands for the site, from what help and completion read: the dataclasses."""

import re

from aerial_il.cli import commands
from aerial_il.cli.commands import Command
from aerial_il.cli.help import meaning_of, ordered_names
from aerial_il.cli.known import of_choice
from aerial_il.core import schema
from aerial_il.core.schema import Key
from aerial_il.presentation.markdown import table

KINDS = ("policy", "algorithm", "gate", "launcher", "sweeper")
EXAMPLE = re.compile(r"^Example: (.*)$", re.MULTILINE)
INTRODUCTION = """\
# Commands

`aerial-il COMMAND key=value ...`: every command with its keys, from the code that reads them. `aerial-il COMMAND
--help` says the same, `aerial-il COMMAND -m seed=0,1,2 policy.chunk=10,20` makes one run of each combination, and
`eval "$(aerial-il completion bash)"` completes commands, keys and values."""


def pages() -> dict[str, str]:
    """Return path on the site -> text: one page for each command, one for each kind of choice, and a list."""
    every = [commands.find(name) for name in ordered_names()]
    rows = [(f"[`{command.name}`]({command.name}.md)", _prose(command.summary)) for command in every]
    groups_row = "What may be chosen by name, with its keys: [choices](groups.md)."
    index = f"{INTRODUCTION}\n\n{table(('command', ''), rows)}\n\n{groups_row}\n"
    of_commands = {f"commands/{command.name}.md": _page(command) for command in every}
    return {"commands/index.md": index, "commands/groups.md": _choices_page(), **of_commands}


def _page(command: Command) -> str:
    examples = "\n".join(EXAMPLE.findall(command.doc))
    text = EXAMPLE.sub("", command.doc).strip()
    keys = _keys(list(schema.keys(command.settings)))
    parts = [
        f"# aerial-il {command.name}",
        _prose(text),
        f"```sh\n{examples}\n```" if examples else "",
        f"## Keys\n\n{keys}",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _keys(keys: list[Key]) -> str:
    rows = [
        (f"`{key.name}`", f"`{key.default}`" if key.default else "required", _prose(meaning_of(key))) for key in keys
    ]
    return table(("key", "default", ""), rows)


def _choices_page() -> str:
    head = (
        "# Choices\n\nA choice is a key whose value is one of several names: `policy=act` chooses, `policy.chunk=20` "
        "changes one value of what is chosen."
    )
    return "\n\n".join([head, *(_choices(kind) for kind in KINDS)]) + "\n"


def _choices(kind: str) -> str:
    each = [f"### {kind}={name}\n\n{_keys(of_choice(kind, name))}" for name in schema.options(kind)]
    return "\n\n".join([f"## {kind}", *each])


def _prose(text: str) -> str:
    """Return a docstring's words as Markdown, with nothing in them that Markdown would take for its own."""
    parts = re.split(r"(``?[^`]+``?)", text)
    return "".join(
        f"`{part.strip('`')}`" if part.startswith("`") else re.sub(r"([*_|<>\[\]])", r"\\\1", part) for part in parts
    )
