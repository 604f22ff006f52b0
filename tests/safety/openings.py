"""How commands open what others made, derived from their keys: a new command, or a new key, is attacked too."""

from collections.abc import Iterator

from aerial_il.cli import commands
from aerial_il.core import schema
from tests.safety.conftest import CLONE, ENV, QUIET
from tests.safety.hostile import Sound

CLOSED = (
    "bench",
    "demo",
    "docs",
    "doctor",
    "film",
    "list",
    "new",
    "simulate",
)  # open nothing of somebody else
PLAIN = {  # keys whose text is no place that is read: names, and places of the user's own
    "action", "cameras", "certificate", "columns", "conditions", "controls", "cuts", "devices", "env",
    "evaluate_tier", "filter_key", "flight_tier", "flights", "format", "hardware", "host", "instruction", "key_file",
    "license", "operator", "parts", "prune", "repo", "sort", "success", "tag", "tiers", "time_scale", "tracker", "ui",
    "uid", "viewer", "where",
}  # fmt: skip
WRITTEN = {  # new files
    ("browse", "out"), ("card", "out"), ("card", "readme"), ("convert", "out"), ("export", "out"), ("publish", "out"),
    ("report", "out"), ("leaderboard", "out"),
    ("reward", "out"), ("view", "out"), ("teleop", "out"),
    ("inspect", "save"), ("inspect", "screenshot"),
}  # fmt: skip
FLOWN = ["episodes=1", "threads=1", QUIET]


def keys() -> Iterator[tuple[str, str]]:
    """Yield command and key wherever a place that may be somebody else's is typed."""
    for name in commands.names():
        for key in schema.keys(commands.find(name).settings):
            opens = key.takes in ("place", "text", "texts", "mapping") and "." not in key.name
            named = key.kind or key.options or key.name in PLAIN
            if opens and not named and name not in CLOSED and (name, key.name) not in WRITTEN:
                yield name, key.name


def beside(sound: Sound) -> dict[tuple[str, str], list[str]]:
    """Return what is typed beside each key so that the command comes to open what the key names.

    A new command or key must say it here; that it does is tested.
    """
    train = ["run=new", *CLONE, "threads=1", QUIET]
    dataset, judged = f"dataset={sound.dataset}", ["videos=0", *FLOWN, "max_steps=5", "success=survived"]
    return {
        ("browse", "dataset"): ["out=seen.html", QUIET],
        ("card", "path"): ["out=seen.html", "films=0", QUIET],
        ("collect", "policy"): [ENV, "out=flown", "max_steps=5", "success=survived", *FLOWN],
        ("collect", "expert"): ["robot=quad", "task=hover", "out=flown", *FLOWN],
        ("collect", "out"): [ENV, "policy=random", "max_steps=5", "success=survived", *FLOWN],
        ("compare", "result"): [],
        ("convert", "path"): ["out=converted", QUIET],
        ("delete", "dataset"): ["where=steps >= 0", QUIET],
        ("evaluate", "policy"): [ENV, "out=judged", *judged],
        ("evaluate", "out"): [ENV, f"policy={sound.run}", *judged],
        ("export", "policy"): ["out=exported"],
        ("export", "evaluation"): [f"policy={sound.run}", "out=exported"],
        ("filter", "dataset"): ["where=steps >= 0", "out=kept", QUIET],
        ("filter", "out"): [dataset, "where=steps >= 0", QUIET],
        ("fly", "policy"): ["out=flown", "episodes=1", QUIET],
        ("fly", "out"): ["policy=hover", "robot=quad", "task=hover", "episodes=1", QUIET],
        ("generate", "dataset"): ["out=made", *FLOWN],
        ("generate", "out"): [dataset, *FLOWN],
        ("info", "path"): [],
        ("inspect", "path"): ["save=seen.rrd"],
        ("inspect", "beside"): [f"path={sound.recording}", "save=seen.rrd"],
        ("inspect", "policy"): [f"path={sound.recording}", "save=seen.rrd"],
        ("judge", "dataset"): [QUIET],
        ("judge", "policy"): [dataset, f"flown={sound.dataset}", QUIET],
        ("judge", "flown"): [dataset, f"policy={sound.run}", QUIET],
        ("merge", "datasets"): ["out=merged", "mix=true", QUIET],
        ("merge", "out"): [f"datasets=[{sound.dataset},{sound.dataset}]", QUIET],
        ("evaluate", "again"): ["out=again", "videos=0", QUIET],
        ("leaderboard", "result"): ["fewest=1", "out=board.html"],
        ("leaderboard", "submission"): [f"result={sound.run}", "episodes=1", "out=board.html", QUIET],
        ("publish", "dataset"): ["out=hub", "license=mit", "films=0", QUIET],
        ("recover", "path"): [],
        ("relabel", "dataset"): ["where=steps >= 0", "tag=seen", QUIET],
        ("replay", "path"): [QUIET],
        ("report", "result"): ["out=report.html"],
        ("report", "run"): ["out=report.html"],
        ("report", "dataset"): ["out=report.html"],
        ("report", "learning_curve"): ["out=curve.svg"],
        ("reward", "run"): [dataset, "out=reward.svg"],
        ("reward", "dataset"): [f"run={sound.run}", "out=reward.svg"],
        ("runs", "folder"): ["page=true", "where=state!=nowhere", "prune=trash"],
        ("prefer", "dataset"): ["length=2", "pairs=1", "out=said.jsonl", QUIET],
        ("prefer", "out"): [dataset, "length=2", "pairs=1", QUIET],
        ("segment", "dataset"): ["page=false"],
        ("split", "dataset"): ["out=parts", QUIET],
        ("split", "out"): [dataset, QUIET],
        ("teleop", "policy"): ["robot=quad", "task=hover", "out=by_hand", "open=false", "port=0"],
        ("train", "dataset"): train,
        ("train", "from"): [dataset, *train],
        ("train", "expert"): [dataset, "algorithm=dagger", *train],
        ("train", "run"): [dataset, *train[1:]],
        ("undo", "dataset"): [QUIET],
        ("validate", "path"): [QUIET],
        ("view", "policy"): [ENV, "viewer=page", "out=seen.html", QUIET],
        ("view", "recording"): ["viewer=page", "out=seen.html", QUIET],
    }


def words(name: str, key: str, value: object, sound: Sound) -> list[str]:
    """Return the command line that has a command open ``value`` through one of its keys."""
    shapes = {"learning_curve": f"{{10:{value}}}", "datasets": f"[{value},{sound.dataset}]"}
    typed = shapes.get(key, value)
    return [name, f"{key}={typed}", *beside(sound)[name, key]]
