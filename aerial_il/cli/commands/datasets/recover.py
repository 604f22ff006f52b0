"""Put a dataset in order after a kill, a full disk or damage: what cannot be trusted goes to quarantine/.

What can be saved of an unfinished or damaged file becomes a whole episode, marked as cut short, in salvaged/. A single
file is left where it is and saved beside itself.

Example: aerial-il recover datasets/pick
"""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.cli.configuration.keys import MISSING, key


@dataclass
class Config:
    path: str = key(MISSING, "dataset, or one file", position=0)


def run(config: Config) -> None:
    """Recover, and say what became of each file."""
    from aerial_il.data.recovery import recover

    recovered = recover(config.path)
    for one in recovered:
        outcome = f"{one.steps} steps saved in {one.path}" if one.steps else f"nothing could be saved, now {one.path}"
        print(f"{one.source}: {outcome} ({one.note})")
    saved = sum(one.steps > 0 for one in recovered)
    print(f"{config.path}: {len(recovered)} files needed help, {saved} of them saved in part or whole.")
