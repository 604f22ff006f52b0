"""Values that nobody means and somebody types, for every key of every command.

The whole of it, an hour: ``python -m tests.cli.hostile_values FOLDER``; a share of it is in the tests.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

from aerial_il.cli import commands
from aerial_il.cli.configuration.compose import compose
from aerial_il.cli.configuration.keys import is_group, output_key
from aerial_il.cli.configuration.overrides import known_keys
from aerial_il.cli.main import main
from aerial_il.core.errors import AerialError

VALUES = (
    "", " ", "null", "nan", "inf", "-inf", "-1", "0", "1e400", "2.5", str(2**63), str(-(2**70)), "true", "no", "None",
    "[]", "[10]", "[[1]]", "[null]", "[-1,-1]", "{}", "{a:1}", "{a:{b:[1]}}", "[a", "{a", "(", "choice(1,2)",
    "${oc.env:HOME}", "${nowhere}", "${", "???", "'", '"', "\\", "a,b", "a=b", "a b", "数据", "ünï/ə", "\x00", "\n",
    "../../../etc/passwd", "/dev/null", "/dev/zero", "/proc/self/mem", "/root/\x01", "x" * 5000, "a/" * 500, "~",
    "$(touch owned)", "`touch owned`", ";ls", "%s%n", "-", "--help", "os:system", "builtins:exec", "1_000", "0x10",
    "1;2", "*", "@", "#", "\u202e", "\udcff",
)  # fmt: skip
BESIDE = {"collect": ["robot=quad", "task=pick_place"]}  # a cell that is declined: nothing long begins
COMPOSED = ("bench", "demo", "docs", "doctor", "film", "list", "teleop")  # begin at once whatever they are told
Case = tuple[str, str, str]


def cases() -> Iterator[Case]:
    """Yield command, key and value; keys of what a group holds by default are among them."""
    for name in commands.names():
        command = commands.find(name)
        yield from ((name, key, value) for key in known_keys(command, command.choices) for value in VALUES)


def typed(name: str, key: str, value: str) -> list[str]:
    """Return the words of a case: places that are not there stand in what else must be said."""
    wanted = [f.name for f in fields(commands.find(name).config) if f.default == "???" and not is_group(f)]
    wanted += ["policy"] * (name == "evaluate") + ["dataset"] * (name == "train")
    places = {name: f"{name}=nowhere" for name in wanted} | ({"kind": "kind=task"} if name == "new" else {})
    beside = [*places.values(), *BESIDE.get(name, [])]
    if name == "new":
        beside += ["into=new"]
    return [f"{key}={value}", *(word for word in beside if word.partition("=")[0] != key.partition(".")[0])]


def answered(name: str, key: str, value: str) -> bool:
    """Whether a case is answered in our words; whatever else is raised goes on."""
    words = typed(name, key, value)
    if name not in COMPOSED and not (key == output_key(commands.find(name).config) and name == "new"):
        return main([name, *words]) in (0, 1, 2)
    try:
        compose(commands.find(name), words)
    except AerialError:
        return True
    return True


def every(share: int, first: int = 0) -> list[Case]:
    """Return one case of ``share``, spread over commands, keys and values."""
    return [case for number, case in enumerate(cases()) if number % share == first]


def _all(folder: Path) -> int:
    """Try every case in a folder of its own; print what was not answered, and how many were."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    told, failed = os.fdopen(os.dup(1), "w"), Counter[str]()
    sys.stdout = sys.stderr = open(os.devnull, "w", errors="backslashreplace")  # noqa: SIM115
    for number, (name, key, value) in enumerate(cases()):
        try:
            failed[name] += not answered(name, key, value)
        except BaseException as error:
            failed[name] += 1
            place = traceback.extract_tb(error.__traceback__)[-1]
            print(f"{name} {key}={value[:40]!r}: {type(error).__name__} {Path(place.filename).name}:{place.lineno}",
                  file=told, flush=True)  # fmt: skip
        if number % 500 == 0:
            print(f"{number} tried, {failed.total()} not answered", file=told, flush=True)
    print(f"{number + 1} tried, {failed.total()} not answered: {dict(failed)}", file=told, flush=True)
    return failed.total()


if __name__ == "__main__":
    sys.exit(min(1, _all(Path(sys.argv[1]))))
