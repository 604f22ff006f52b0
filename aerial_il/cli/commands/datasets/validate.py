"""Read every recording in full and say which cannot be trusted, and why; status 2 if there is one.

Checks: checksums, digest and index; schema, shapes and types; finite values and bounds; times, sequence and end.

Example: aerial-il validate datasets/pick
Example: aerial-il validate datasets/pick replay=true
"""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.cli.configuration.keys import MISSING, key
from aerial_il.cli.configuration.quoting import command_line


@dataclass
class Config:
    path: str = key(MISSING, "dataset, or one file", position=0)
    replay: bool = key(False, "also fly each episode again and require equal states (as aerial-il replay)")
    progress: bool = key(True, "show a progress bar")


def run(config: Config) -> None:
    """Print the problems, or that there are none."""
    from aerial_il.cli.commands.datasets import replay
    from aerial_il.core.errors import DemoError
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import altered_files, open_dataset

    dataset = open_dataset(config.path, cameras=True, failures=True)
    checked = Progress(dataset.problems(), total=len(dataset), desc="validate", unit="ep", disable=not config.progress)
    problems = [str(error) for _, error in checked if error is not None]
    problems += [f"{file}: differs from what the index lists." for file in altered_files(config.path)]
    for problem in problems:
        print(problem)
    if problems:
        hint = f"Set them aside and save what can be saved: {command_line(['recover', f'path={config.path}'])}"
        raise DemoError(config.path, f"{len(problems)} problems in {len(dataset)} episodes.", hint=hint)
    if config.replay:
        replay.run(replay.Config(config.path, progress=config.progress))
    print(f"{config.path}: {len(dataset)} episodes, all sound.")
