"""The smallest complete example of each kind: what ``aerial-il new`` writes, and what the pages show."""

from pathlib import Path
from string import Template

FILES = {  # kind -> the text of this folder, and where it belongs below a checkout
    "task": {
        "task.py.txt": "aerial_il/suite/tasks/$name.py",
        "expert.py.txt": "aerial_il/experts/$name.py",
    },
    "robot": {"robot.py.txt": "aerial_il/robots/$name.py"},
    "disturbance": {"disturbance.py.txt": "aerial_il/suite/disturbances/$name.py"},
    "sensor": {"sensor.py.txt": "aerial_il/suite/sensors/$name.py"},
    "controller": {"controller.py.txt": "aerial_il/control/controllers/$name.py"},
    "format": {"format.py.txt": "aerial_il/data/formats/$name.py"},
    "policy": {"policy.py.txt": "aerial_il/policies/$name.py"},
    "algorithm": {"algorithm.py.txt": "aerial_il/algorithms/$name.py"},
    "study": {"study.py.txt": "experiments/$name/study.py"},
}


def start(kind: str, name: str) -> dict[str, str]:
    """Return the files of something new: path below a checkout -> text.

    Args:
        kind: a key of ``FILES``. name: what it shall be called, e.g. ``stack_cubes``.
    """
    words = {"name": name, "Name": "".join(word.capitalize() for word in name.split("_"))}
    return {
        Template(path).substitute(words): Template((Path(__file__).parent / text).read_text("utf-8")).substitute(words)
        for text, path in FILES[kind].items()
    }
