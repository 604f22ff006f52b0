"""Pages name files that are there, and every command line that they show composes: keys known, values fit."""

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from aerial_il.cli import commands
from aerial_il.cli.compose import points, settings_of, space
from aerial_il.cli.known import known
from aerial_il.cli.words import SWEEPER, read
from aerial_il.core.errors import AerialError
from aerial_il.core.schema import options

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)[^)]*\)")
CODE = re.compile(r"`((?:aerial_il|tests|conf|setup|docs|notebooks|experiments)/[\w./-]+\.\w+)`")
SHOWN = re.compile(r"^`([\w./-]+)`\n\n```", re.MULTILINE)  # a file whose content follows, for the reader to write
SAID = re.compile(r"``([\w.-]+(?:/[\w.-]+)+\.(?:py|md|toml|js|html|css))``")  # in a docstring
FORMS = re.compile(r"\b(NAME|GROUP)\b")  # stand for any name
HISTORY = "CHANGELOG.md"  # tells of files that are gone


def pages() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in listed.splitlines()]


def missing(page: Path, text: str) -> list[str]:
    """Return what ``text`` links to or names that is not there."""
    links = [name for name in LINK.findall(text) if not (page.parent / name).exists()]
    named = {*CODE.findall(text)} - {*SHOWN.findall(text)}
    paths = sorted(name for name in named if not re.search(r"\bNAME\b|\bX\b", name) and not (ROOT / name).exists())
    return links + paths


def sources() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "aerial_il/*.py"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.splitlines()]


def gone(text: str) -> list[str]:
    """Return the files that code names, of packages and folders of ours, that are not there."""
    tops = (ROOT, ROOT / "aerial_il", ROOT / "docs")
    ours = {path.name for top in tops for path in top.iterdir() if path.is_dir()}
    named = (name for name in SAID.findall(text) if name.split("/")[0] in ours and not FORMS.search(name))
    return sorted(name for name in named if not any((top / name).exists() for top in tops))


def test_what_docstrings_name_is_there() -> None:
    lost = {str(file.relative_to(ROOT)): result for file in sources() if (result := gone(file.read_text("utf-8")))}
    assert lost == {}


def test_a_docstring_that_names_what_is_gone_is_found() -> None:
    text = "``suite/gone.py``, ``aerial_il/gone.py``, ``suite/batch.py``, ``docs/tiers.md``, ``robots/NAME.md``"
    text += ", ``d4rl/elsewhere.py``"
    assert gone(text) == ["aerial_il/gone.py", "suite/gone.py"]


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_is_there(page: Path) -> None:
    if page.name != HISTORY:
        assert missing(page, page.read_text(encoding="utf-8")) == []


def test_what_is_not_there_is_found() -> None:
    there = "[b](https://example.org/x.md) `aerial_il/robots/NAME.py` `aerial_il/__init__.py`"
    shown = "`aerial_il/new.py`\n\n```python\npass\n```"
    text = f"[a](nowhere.md) `aerial_il/gone.py` {there}\n\n{shown}\n"
    assert missing(ROOT / "README.md", text) == ["nowhere.md", "aerial_il/gone.py"]


def test_every_page_is_listed_where_readers_begin() -> None:
    """Or in the overview of its own folder, such as those of the robots and the tasks."""
    docs = ROOT / "docs"
    start = (docs / "index.md").read_text(encoding="utf-8")
    lost = [page.name for page in docs.glob("*.md") if page.name != "index.md" and f"({page.name})" not in start]
    assert lost == [], "name them in docs/index.md, under the heading of their kind"


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.name)
def test_a_page_is_read_in_one_sitting(page: Path) -> None:
    """At most 1,500 words beside its code: longer ones are split by topic."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert sum(any(letter.isalnum() for letter in word) for word in prose.split()) <= 1500


PAGES = sorted({*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("experiments/*/README.md")})
NOTEBOOKS = sorted(ROOT.glob("notebooks/**/*.py"))
FENCED = re.compile(r"^ *```(?:sh|bash|console|)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
OPEN = re.compile(r"\.\.\.|…|\b(?:NAME|COMMAND|KIND|LINE)\b")  # left to the reader
SKIPPED = ("completion", "help")  # no keys
INSIDE = re.compile(r"`(algorithm|policy)\.([a-z_]+(?:\.[a-z_]+)*)(?:=[^`]*)?`")  # a setting named in a sentence
EXAMPLES = (
    "touch_point",
    "touch_ball",
    "linear",
    "gull",
    "two_joint_hexa",
    "hovering",
    "tern",
)  # the reader writes them


def shown(page: Path) -> list[str]:
    """Return the command lines that a page shows, each on one line."""
    text = page.read_text(encoding="utf-8")
    blocks = FENCED.findall(text) if page.suffix == ".md" else re.findall(r"^# ?(.*)$", text, re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    lines = [" ".join(line.split()).removeprefix("$ ") for line in lines]
    return [line for line in lines if line.startswith("aerial-il ")]


def check(line: str) -> None:
    """Compose a command line as the console script would.

    Raises:
        AerialError: an unknown key, a value that does not fit, a word too many.
    """
    name, *words = shlex.split(line.removesuffix("&"), comments=True)[1:]
    if name in SKIPPED or {"-h", "--help", "--version"} & {name, *words}:
        return
    command = commands.find(name)
    said = read(command, [word for word in words if not word.startswith("from=")])  # of a run that is not here
    if said.apart[SWEEPER]:
        assert space(command, said.overrides)
    elif said.sweeps:
        assert all(settings_of(command, point) for point, _ in points(command, said.overrides))
    else:
        settings_of(command, said.overrides)


def lines() -> Iterator[Any]:
    for page in (*PAGES, *NOTEBOOKS):
        for line in dict.fromkeys(shown(page)):
            if not OPEN.search(line) and not any(name in line for name in EXAMPLES):
                yield pytest.param(line, id=f"{page.relative_to(ROOT)}: {line}")


@pytest.mark.parametrize("line", [*lines()])
def test_a_command_that_is_shown_composes(line: str) -> None:
    check(line)


@pytest.mark.parametrize("words", ["train run=x algorithm.stepz=3", "collect robott=quad", "flyy"])
def test_a_command_that_does_not_compose_is_seen(words: str) -> None:
    with pytest.raises(AerialError):
        check(f"aerial-il {words}")


def settings(group: str) -> set[str]:
    """Return all keys of all choices of a group, and the groups of keys."""
    train, gates = commands.find("train").settings, {f"{group}.gate": list(options("gate"))}
    every = known(train, {group: list(options(group)), **(gates if group == "algorithm" else {})})
    result = {name.removeprefix(f"{group}.") for name in every if name.startswith(f"{group}.")}
    return result | {".".join(name.split(".")[:i]) for name in result for i in range(1, name.count(".") + 1)}


@pytest.mark.parametrize("group", ["algorithm", "policy"])
def test_settings_named_in_sentences_are_there(group: str) -> None:
    there = settings(group)
    named = {
        (str(page.relative_to(ROOT)), name)
        for page in PAGES
        if page.name != "CHANGELOG.md"
        for kind, name in INSIDE.findall(page.read_text(encoding="utf-8"))
        if kind == group
    }
    assert sorted((page, name) for page, name in named if name not in there and name != "name") == []
