"""Files of others: what opens, trains and flies by the shipped commands, and what is said where one of them does not.

One script flies one arm, and its flights are kept as other tools keep theirs. Each file then goes the way of a user:
``validate``, ``train`` with the shipped defaults, ``evaluate`` on reserved seeds, in processes of their own. The
control is a policy trained on what ``collect`` recorded of the same flights. Killed at any moment, the same call goes
on.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.core.rendering import can_render
from experiments.adroit.tasks import POLICIES
from experiments.common.record import Record
from experiments.common.report import Report, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.foreign.arm import flown
from experiments.foreign.files import ENV, PEOPLE, REACHED, ForeignFile, of_people, of_the_arm
from experiments.foreign.odd import Write, odd_files
from experiments.foreign.steps import Said, call, flight_row, opened, size_mb

PILOT = "policy=experiments.foreign.arm:pilot"
CONTROL, SCRIPT, EXPERT = "recorded here", "the script itself", "the hand's expert itself"
BEHIND_POINTS, ODD_FLIGHTS = 5.0, 10
FOUND, JUDGED, QUIET = "found.json", "judged", "progress=false"
Found = dict[str, Any]
NOTES = (
    "One script (inverse kinematics and damping, without noise) flies Gymnasium's Reacher-v5 on seeds 0 on; success is "
    "a return of -8 at least. All files of the arm hold these very flights, in the layouts that the tools document; "
    "LeRobot's are written by lerobot itself. Minari, robomimic, MimicGen and ALOHA were not installed.",
    "Each file: `aerial-il validate FILE`, `train dataset=FILE run=RUN`, `evaluate policy=RUN success=RULE`, and what "
    "stands under told. Opens: wall time of opening and reading all, in a process that has imported all. One training "
    "each, of the default policy and steps, 10,000; from pictures of the given number.",
    "Control: trained likewise on what `aerial-il collect` recorded of the same script and seeds. All policies are "
    "judged on the same reserved seeds; low and high: Wilson's 95 % interval.",
    "A file flies if its policy comes to an evaluation; how well stands in the table. ALOHA keeps a file for each "
    "flight, and each is probed in a process of its own, which is most of what opening takes.",
    "Pictures: 84 x 84 from above, which alone show the target, beside the joints, in an environment of the study. No "
    "control was recorded, and the steps were cut to 500 for time: success says that it flies, not how well it could.",
    "People's door: 25 demonstrations in virtual reality of AdroitHandDoor-v1, published by the authors of DAPG; "
    "success is the goal held in more than 25 of 200 steps. No control was trained with these settings; the clone of "
    "the same flights in the study adroit_rl, judged over 400 steps, succeeds in 1 of 100.",
    "Odd files: ten flights with one thing wrong, and kinds of files that are not read. Said: the first line of "
    "`validate` that it does not say of a sound file.",
)


@dataclass(frozen=True, kw_only=True)
class Foreign:
    """Settings.

    Attributes:
        demos: flights that each file of the arm holds. picture_steps: of training from pictures.
        data: folder of people's flights of the Adroit hand, ``door_human_demos.npz``, and of ``dapg_policies.npz``.
        episodes: that judge a policy. first_episode: the first of them.
    """

    name: ClassVar[str] = "foreign"
    question: ClassVar[str] = "Do files of other tools open, train and fly by the shipped commands as they are?"

    demos: int = 100
    picture_steps: int = 500
    data: str = "datasets/adroit"
    episodes: int = 100
    first_episode: int = EVALUATION_SEED

    def __post_init__(self) -> None:
        if min(self.demos, self.episodes, self.picture_steps) < 1:
            raise InvalidValueError("demos, episodes and picture_steps start at 1.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Write, open, train and fly what ``folder`` does not hold yet; see :class:`Study`."""
        record, data, seeds = Record(folder), Path(self.data), range(self.demos)
        people = of_people(data) if (data / PEOPLE).is_file() else []
        pictured = list(flown(seeds, pictures=True)) if can_render() else []
        arm = of_the_arm(list(flown(seeds)), pictured)
        files = bar([self._recorded(), *arm, *people], self.name, progress)
        ways = {file.name: self._once(record, "files", file.name, partial(self._way, file)) for file in files}
        sound, kinds = odd_files(list(flown(range(ODD_FLIGHTS))))
        usual = self._once(record, "odd", "sound", partial(_odd, "sound", sound, ()))["lines"]
        odd = {
            what: self._once(record, "odd", what, partial(_odd, what, write, usual))
            for what, write in bar(kinds.items(), "odd files", progress)
        }
        pilots = {
            file.name: self._once(record, "pilots", file.name, partial(self._piloted, file, policy))
            for file, policy in _pilots(data, people)
        }
        skipped = (
            () if people else (f"{self.data} has no {PEOPLE}: people's flights were skipped (bench.data=FOLDER).",)
        )
        skipped += () if pictured else ("Nothing renders here: files with pictures were skipped.",)
        return Report(
            study=self,
            targets=tuple(targets_of(ways)),
            tables={
                "Files": [way["file"] for way in ways.values()],
                "Flights": [way["flight"] for way in (*pilots.values(), *ways.values())],
                "Odd files": [found["row"] for found in odd.values()],
            },
            notes=(*NOTES, *skipped, *record.notes()),
            details={"said": {name: way["said"] for name, way in ways.items()}},
            wall_time_s=sum(found["seconds"] for part in (ways, odd, pilots) for found in part.values()),
        )

    def _once(self, record: Record, kind: str, name: str, find: Callable[[Path], Found]) -> Found:
        """Return what ``find`` says in an empty folder, or what it said there before."""
        judged = {"seeds": [self.first_episode, self.episodes], "demos": self.demos, "steps": self.picture_steps}
        place = record.place(kind, name, {"name": name, **judged})
        if not (place / FOUND).exists():
            shutil.rmtree(place / "work", ignore_errors=True)
            (place / "work").mkdir()
            started = time.perf_counter()
            found = find(place / "work")
            write_json(place / FOUND, {**found, "seconds": time.perf_counter() - started})
        return json.loads((place / FOUND).read_text())

    def _recorded(self) -> ForeignFile:
        """Return the control: the same flights, as ``collect`` records them."""
        words = ("collect", ENV, PILOT, f"success={REACHED}", f"episodes={self.demos}", "threads=1", QUIET)

        def write(at: Path) -> Path:
            call(*words, "out=recorded", at=at)
            return at / "recorded"

        return ForeignFile(name=CONTROL, form="recordings", write=write)

    def _way(self, file: ForeignFile, at: Path) -> Found:
        """Return how far a file comes."""
        told = [f"policy.images=[{file.pictures}]", f"algorithm.steps={self.picture_steps}"] if file.pictures else []
        path = file.write(at)
        held, checked = opened(path), call("validate", path.name, QUIET, at=at)
        trained = call("train", f"dataset={path.name}", "run=run", *told, QUIET, at=at)
        judged = self._judged(file, "policy=run", at) if trained.ok else trained
        size = {"file": file.name, "format": file.form, "size_mb": size_mb(path)}
        return {
            "file": {**size, **held, "validate": checked.verdict},
            "flight": flight_row(at / JUDGED, file.name, judged, trained.seconds, " ".join((*told, *file.flown))),
            "trains": trained.ok,
            "like_the_control": file.pictures is None and file.success == REACHED,
            "said": {"validate": checked.out, "train": trained.ours, "evaluate": judged.ours},
        }

    def _piloted(self, file: ForeignFile, policy: str, at: Path) -> Found:
        """Return how the one flies who demonstrated."""
        judged = self._judged(file, policy, at)
        return {"flight": flight_row(at / JUDGED, file.name, judged, None, " ".join(file.flown))}

    def _judged(self, file: ForeignFile, policy: str, at: Path) -> Said:
        seeds = (f"episodes={self.episodes}", f"seed={self.first_episode}")
        where = (f"success={file.success}", *file.flown)
        return call("evaluate", policy, *where, *seeds, "threads=1", "videos=0", f"out={JUDGED}", QUIET, at=at)


def _pilots(data: Path, people: Sequence[ForeignFile]) -> Iterator[tuple[ForeignFile, str]]:
    """Yield where those fly who demonstrated, and as which policy."""
    yield ForeignFile(name=SCRIPT, form="", write=Path, flown=(ENV,)), PILOT
    if people and (data / POLICIES).is_file():
        yield replace(people[0], name=EXPERT), f"policy={(data / POLICIES).resolve()}"


def _odd(what: str, write: Write, usual: Collection[str], at: Path) -> Found:
    """Return what is said of a file that is not said of a sound one."""
    path = write(at)
    checked, held = call("validate", path.name, QUIET, at=at), opened(path)
    said = next((line for line in (*checked.out, checked.verdict) if line not in usual), "")
    counts = {"episodes": held["episodes"], "successes": held["successes"]}
    return {"row": {"what": what, **counts, "said": said}, "lines": checked.out}


def targets_of(ways: dict[str, Found]) -> Iterator[Target]:
    """Yield that all files come all the way, and that nothing is lost on it."""
    theirs = {name: way for name, way in ways.items() if name != CONTROL}
    stages = {
        "open": lambda way: way["file"]["episodes"] > 0,
        "train": lambda way: way["trains"],
        "fly": lambda way: way["flight"]["percent"] is not None,
    }
    for stage, holds in stages.items():
        lacking = [name for name, way in theirs.items() if not holds(way)]
        yield Target(f"files that {stage}", "at least", len(theirs), len(theirs) - len(lacking), "", ", ".join(lacking))
    control = ways[CONTROL]["flight"]["percent"]
    flew = {name: way["flight"]["percent"] for name, way in theirs.items() if way["like_the_control"]}
    if same := {name: percent for name, percent in flew.items() if percent is not None}:
        worst = min(same, key=lambda name: same[name])
        what = "success of policies of the same numbers, against the control"
        yield Target(what, "at least", -BEHIND_POINTS, round(same[worst] - control, 1), "points", f"worst: {worst}")
