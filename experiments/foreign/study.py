"""Files of others: what opens, trains and flies by the shipped commands, and what is said where one of them does not.

One script flies one arm, and its flights are kept as other tools keep theirs. Each file then goes the way of a user:
``validate``, ``train`` with the shipped defaults, ``evaluate`` on reserved seeds, in processes of their own. The control
is a policy trained on what ``collect`` recorded of the same flights. Killed at any moment, the same call goes on.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from experiments.adroit.tasks import POLICIES
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.foreign.arm import flown
from experiments.foreign.files import ENV, PEOPLE, REACHED, ForeignFile, of_people, of_the_arm
from experiments.foreign.odd import Write, odd_files
from experiments.foreign.steps import call, flight_row, opened, size_mb

PILOT = "policy=experiments.foreign.arm:pilot"
CONTROL, SCRIPT, EXPERT = "recorded here", "the script itself", "the hand's expert itself"
BEHIND_POINTS, ODD_FLIGHTS = 5.0, 10
WAY = "way.json"
NOTES = (
    "One script (inverse kinematics and damping, without noise) flies Gymnasium's Reacher-v5 on seeds 0 on; success is "
    "a return of -8 at least. All files of the arm hold these very flights, in the layouts that the tools document; "
    "LeRobot's are written by lerobot itself. Minari, robomimic, MimicGen and ALOHA were not installed.",
    "Each file: `aerial-il validate FILE`, `train dataset=FILE run=RUN`, `evaluate policy=RUN success=RULE`, and what "
    "stands under told. Opens: wall time of opening and reading all, in a process that has imported all. One training "
    "each, of the default policy and steps, 10,000; from pictures of the given number.",
    "Control: trained likewise on what `aerial-il collect` recorded of the same script and seeds. All policies are "
    "judged on the same reserved seeds; low and high: Wilson's 95 % interval.",
    "Pictures: 84 x 84 from above, which alone show the target, beside the joints, of an environment of the study's own.",
    "People's door: 25 demonstrations in virtual reality of AdroitHandDoor-v1 by the authors of DAPG; success is the "
    "goal held in more than 25 of 200 steps, and the control its own expert. That a clone of 25 people's flights hardly "
    "succeeds is no matter of files.",
    "Odd files: ten flights with one thing wrong, and kinds of files that are not read; what `validate` says of each.",
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
    picture_steps: int = 2_000
    data: str = "datasets/adroit"
    episodes: int = 100
    first_episode: int = EVALUATION_SEED

    def __post_init__(self) -> None:
        if min(self.demos, self.episodes, self.picture_steps) < 1:
            raise InvalidValueError("demos, episodes and picture_steps start at 1.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Write, open, train and fly what ``folder`` does not hold yet; see :class:`Study`."""
        record, data = Record(folder), Path(self.data)
        people = of_people(data) if (data / PEOPLE).is_file() else []
        files = [self._recorded(), *self._of_the_arm(), *people]
        ways = {file.name: self._way(record, file) for file in bar(files, self.name, progress)}
        odd = [self._odd(record, what, write) for what, write in bar(list(self._odd_files()), "odd files", progress)]
        pilots = list(self._pilots(record, data))
        flights = [*pilots, *(way["flight"] for way in ways.values())]
        missing = (
            () if people else (f"{self.data} has no {PEOPLE}: people's flights were skipped (bench.data=FOLDER).",)
        )
        return Report(
            study=self,
            targets=tuple(_targets(ways)),
            tables={"Files": [way["file"] for way in ways.values()], "Flights": flights, "Odd files": odd},
            notes=(*NOTES, *missing, *record.notes()),
            details={"said": {name: way["said"] for name, way in ways.items()}},
            wall_time_s=sum(way["seconds"] for way in ways.values())
            + sum(row.pop("seconds") for row in (*odd, *pilots)),
        )

    def _recorded(self) -> ForeignFile:
        """Return the control: the same flights, as ``collect`` records them."""
        words = ("collect", ENV, PILOT, f"success={REACHED}", f"episodes={self.demos}", "threads=1", "progress=false")

        def write(at: Path) -> Path:
            call(*words, "out=recorded", at=at)
            return at / "recorded"

        return ForeignFile(name=CONTROL, form="recordings", write=write)

    def _of_the_arm(self) -> list[ForeignFile]:
        seeds = range(self.demos)
        return of_the_arm(list(flown(seeds)), list(flown(seeds, pictures=True)))

    def _odd_files(self) -> Iterator[tuple[str, Write]]:
        yield from odd_files(list(flown(range(ODD_FLIGHTS)))).items()

    def _flying(self, file: ForeignFile) -> list[str]:
        judged = [f"episodes={self.episodes}", f"seed={self.first_episode}"]
        return [f"success={file.success}", *file.flown, *judged, "threads=1", "videos=0", "progress=false"]

    def _place(self, record: Record, kind: str, name: str, **settings: Any) -> Path:
        judged = {"seeds": [self.first_episode, self.episodes]}
        return record.place(kind, name, {"name": name, "demos": self.demos, **judged, **settings})

    def _way(self, record: Record, file: ForeignFile) -> dict[str, Any]:
        """Return how far a file comes, measured once."""
        told = [f"policy.images=[{file.pictures}]", f"algorithm.steps={self.picture_steps}"] if file.pictures else []
        at = self._place(record, "files", file.name, told=told, flown=file.flown)
        if (at / WAY).exists():
            return json.loads((at / WAY).read_text())
        started, path = time.perf_counter(), file.write(at)
        held = opened(path)
        checked = call("validate", path.name, "progress=false", at=at)
        trained = call("train", f"dataset={path.name}", "run=run", *told, "progress=false", at=at)
        judged = call("evaluate", "policy=run", *self._flying(file), "out=judged", at=at) if trained.ok else trained
        flight = flight_row(at / "judged", file.name, judged, trained.seconds, " ".join((*told, *file.flown)))
        way = {
            "file": {
                "file": file.name,
                "format": file.form,
                "size_mb": size_mb(path),
                **held,
                "validate": checked.last,
            },
            "flight": flight,
            "trains": trained.ok,
            "numbers": file.pictures is None and file.success == REACHED,
            "said": {"validate": checked.lines, "train": trained.lines, "evaluate": judged.lines},
            "seconds": time.perf_counter() - started,
        }
        write_json(at / WAY, way)
        return way

    def _pilots(self, record: Record, data: Path) -> Iterator[Row]:
        """Yield what those fly who demonstrated."""
        yield self._pilot(record, ForeignFile(name=SCRIPT, form="", write=Path, flown=(ENV,)), PILOT)
        if (data / POLICIES).is_file():
            hand, policy = of_people(data)[0], f"policy={(data / POLICIES).resolve()}"
            yield self._pilot(
                record, ForeignFile(name=EXPERT, form="", write=Path, flown=hand.flown, success=hand.success), policy
            )

    def _pilot(self, record: Record, file: ForeignFile, policy: str) -> Row:
        at = self._place(record, "pilots", file.name, flown=file.flown)
        if not (at / WAY).exists():
            judged = call("evaluate", policy, *self._flying(file), "out=judged", at=at)
            row = flight_row(at / "judged", file.name, judged, None, " ".join(file.flown))
            write_json(at / WAY, {**row, "seconds": judged.seconds})
        return json.loads((at / WAY).read_text())

    def _odd(self, record: Record, what: str, write: Write) -> Row:
        at = self._place(record, "odd", what)
        if not (at / WAY).exists():
            path = write(at)
            checked = call("validate", path.name, "progress=false", at=at)
            row = {
                "what": what,
                "episodes": opened(path)["episodes"],
                "said": checked.lines[0],
                "seconds": checked.seconds,
            }
            write_json(at / WAY, row)
        return json.loads((at / WAY).read_text())


def _targets(ways: dict[str, dict[str, Any]]) -> Iterator[Target]:
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
    same = {n: w["flight"]["percent"] for n, w in theirs.items() if w["numbers"] and w["flight"]["percent"] is not None}
    if same:
        worst = min(same, key=lambda name: same[name])
        what = "success of a policy of the same numbers, against the control"
        yield Target(what, "at least", -BEHIND_POINTS, round(same[worst] - control, 1), "points", f"worst: {worst}")
