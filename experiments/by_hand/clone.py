"""Clone flights by hand as ``aerial-il train`` does it by itself, and judge each training on unseen seeds.

    python -m experiments.by_hand.clone run reach_keys --dataset runs/teleop/reach_keys
    python -m experiments.by_hand.clone run reach_keys_recorded --dataset runs/teleop/reach_keys dataset.by_hand=false
    python -m experiments.by_hand.clone table

Words at the end of ``run`` are settings of ``aerial-il train``. Trainings differ in their weights, minibatches and in
which demonstrations are held out for validation. What is trained and judged is not done again. Results lie in
``experiments/by_hand/cloning``, a file for each name; with ``--tier``, for each name and tier.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from aerial_il.cli.main import main as aerial_il
from aerial_il.data.dataset import open_dataset
from aerial_il.evaluation.result import FILE_NAME, load_result
from aerial_il.evaluation.statistics import wilson

RESULTS = Path(__file__).parent / "cloning"


def run(args: argparse.Namespace, settings: list[str]) -> None:
    """Train and judge what is not done yet, and write it down."""
    flown = open_dataset(args.dataset)
    spec = flown.spec
    if args.others:
        settings = [*settings, f"dataset.others=[{','.join(args.others)}]"]
    count = sum(len(open_dataset(place)) for place in (args.dataset, *args.others))
    about = {"task": spec.task, "robot": spec.robot, "demonstrations": count, "settings": settings}
    name = args.name if args.tier == "calm" else f"{args.name}_{args.tier}"
    trainings = [judged(args, settings, seed, spec.robot, spec.task) for seed in range(args.trainings)]
    RESULTS.mkdir(exist_ok=True)
    told = {**about, "seeds": [args.seed, args.seed + args.episodes - 1], "trainings": trainings}
    (RESULTS / f"{name}.json").write_text(json.dumps(told, indent=1) + "\n")
    table()


def judged(args: argparse.Namespace, settings: list[str], seed: int, robot: str, task: str) -> dict[str, Any]:
    """Return how one training flies; train and fly it first, or what is left of it."""
    folder = Path(args.out) / args.name / f"seed={seed}"
    learned, judged = [f"dataset={args.dataset}", f"seed={seed}", *settings], folder / f"{args.tier}_{args.seed}"
    words = [f"robot={robot}", f"task={task}", f"tier={args.tier}", f"episodes={args.episodes}", f"seed={args.seed}"]
    commands = (
        ["train", *learned, f"run={folder}"],
        ["evaluate", f"policy={folder}", *words, "videos=0", "threads=1", f"out={judged}"],
    )
    for command in () if (judged / FILE_NAME).exists() else commands:
        if aerial_il([*command, "progress=false"]):
            raise SystemExit(f"aerial-il {' '.join(command)} has failed.")
    result = load_result(judged)
    failed = [flight.seed for flight in result.episodes if not flight.success]
    return {"seed": seed, "flown": args.episodes, "solved": args.episodes - len(failed), "failed_seeds": failed}


def table() -> None:
    """Print what was judged, with Wilson intervals of 95 % over all flights."""
    print("| demonstrations | settings | seeds | each training | success | 95 % |")
    print("|---|---|---|---|--:|---|")
    for file in sorted(RESULTS.glob("*.json")):
        told = json.loads(file.read_text())
        each = [training["solved"] for training in told["trainings"]]
        flown = sum(training["flown"] for training in told["trainings"])
        low, high = wilson(sum(each), flown)
        print(
            f"| {told['demonstrations']} {file.stem} | {' '.join(told['settings']) or 'as shipped'} "
            f"| {told['seeds'][0]}–{told['seeds'][1]} | {', '.join(map(str, each))} "
            f"| {100 * sum(each) / flown:.1f} % | {100 * low:.1f}–{100 * high:.1f} % |"
        )


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "table"))
    parser.add_argument("name", nargs="?", default="clone")
    parser.add_argument("--dataset")
    parser.add_argument("--others", nargs="+", default=())
    parser.add_argument("--tier", default="calm")
    parser.add_argument("--trainings", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=20000)
    parser.add_argument("--out", default="runs/by_hand")
    args, settings = parser.parse_known_args()
    if args.command == "table":
        table()
    elif args.dataset is None:
        parser.error("run NAME needs --dataset PATH")
    else:
        run(args, settings)


if __name__ == "__main__":
    main()
