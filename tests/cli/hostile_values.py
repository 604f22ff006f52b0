"""Values that nobody means and somebody types, for every key of every command."""

from collections.abc import Iterator
from dataclasses import MISSING, fields

from aerial_il.cli import commands
from aerial_il.cli.compose import compose
from aerial_il.cli.known import known
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
DECLINED = ["robot=quad", "task=pick_place"]  # a cell that is declined: nothing long begins
BESIDE = {
    "collect": DECLINED, "demo": DECLINED, "teleop": [*DECLINED, "open=false", "port=0"],
    "film": ["out=film.webp", "flights=[quad/pick_place]"],
}  # fmt: skip
COMPOSED = ("bench", "docs", "doctor")  # begin at once whatever they are told
ANSWERS = {0: "done", 1: "failed", 2: "refused"}
Case = tuple[str, str, str]


def cases() -> Iterator[Case]:
    """Yield command, key and value; keys of what a group holds by default are among them."""
    for name in commands.names():
        yield from ((name, key, value) for key in known(commands.find(name).settings, {}) for value in VALUES)


def typed(name: str, key: str, value: str) -> list[str]:
    """Return the words of a case: places that are not there stand in what else must be said."""
    needed = (f for f in fields(commands.find(name).settings) if f.default is f.default_factory is MISSING)
    wanted = [f.name for f in needed] + ["dataset"] * (name == "train")
    places = {name: f"{name}=nowhere" for name in wanted} | ({"kind": "kind=task"} if name == "new" else {})
    beside = [*places.values(), *BESIDE.get(name, [])]
    if name == "new":
        beside += ["into=new"]
    return [f"{key}={value}", *(word for word in beside if word.partition("=")[0] != key.partition(".")[0])]


def answered(name: str, key: str, value: str) -> bool:
    """Whether a case is answered in our words; whatever else is raised goes on."""
    return answer(name, key, value) in ANSWERS


def answer(name: str, key: str, value: str) -> int:
    """Return the exit status of a case, of those whose configuration alone is composed too."""
    words = typed(name, key, value)
    if not _only_composed(name, key, value):
        return main([name, *words])
    try:
        compose(commands.find(name), words)
    except AerialError:
        return 2
    return 0


def _only_composed(name: str, key: str, value: str) -> bool:
    unheld = {  # what holds the command back is what is tried, or it would write outside of the folder of these cases
        ("film", "flights"): True,
        ("list", "html"): value == "true",  # pictures of all robots and tasks
        ("teleop", "robot"): value == "null",
        ("teleop", "task"): value == "null",
        ("new", "into"): value == "null" or value.startswith("/root"),
    }
    return name in COMPOSED or unheld.get((name, key), False)


def every(share: int, first: int = 0) -> list[Case]:
    """Return one case of ``share``, spread over commands, keys and values."""
    return [case for number, case in enumerate(cases()) if number % share == first]
