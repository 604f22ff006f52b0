"""Say which of two pieces of flight is the better one, for algorithm=cpl: a script does, or you on a page.

The script prefers the segment that brought success nearer, as flights that succeed tell it; it uses no reward. Answers
are appended to out=FILE.jsonl as they are given, and the same command goes on where it was stopped.

Example: aerial-il prefer datasets/mixed pairs=2000 out=mixed.jsonl
Example: aerial-il prefer datasets/mixed pairs=2000 flipped=0.1 out=careless.jsonl
Example: aerial-il prefer datasets/mixed by=hand out=mine.jsonl
Example: aerial-il train dataset=datasets/mixed algorithm=cpl algorithm.preferences=mixed.jsonl run=runs/preferred
"""

from aerial_il.cli.greeting import greeting
from aerial_il.workflows.prefer import Prefer, prefer
from aerial_il.workflows.spelling import command_line, path

SETTINGS, BARE = Prefer, ("dataset",)


def run(settings: Prefer) -> None:
    """Judge, or serve the page until interrupted, and say what the file holds."""
    made = prefer(settings, greeting("Judge", "; the same command goes on", open_page=settings.open))
    counts = ", ".join(f"{made.counts.get(name, 0)} {name}" for name in ("left", "right", "equal"))
    print(f"{made.path}: {sum(made.counts.values())} pairs, {counts}.")
    answers = path("algorithm.preferences", settings.out)
    words = ["train", path("dataset", settings.dataset), "algorithm=cpl", answers, "run=runs/preferred"]
    print(f"Next: {command_line(words)}")
