"""Put a dataset in order after a kill, a full disk or damage: what cannot be trusted goes to quarantine/.

What can be saved of an unfinished or damaged file becomes a whole episode, marked as cut short, in salvaged/. A single
file is left where it is and saved beside itself.

Example: aerial-il recover datasets/pick
"""

from aerial_il.workflows.recover import Recover, recover

SETTINGS, BARE = Recover, ("path",)


def run(settings: Recover) -> None:
    """Recover, and say what became of each file."""
    recovered = recover(settings)
    for one in recovered:
        outcome = f"{one.steps} steps saved in {one.path}" if one.steps else f"nothing could be saved, now {one.path}"
        print(f"{one.source}: {outcome} ({one.note})")
    saved = sum(one.steps > 0 for one in recovered)
    print(f"{settings.path}: {len(recovered)} files needed help, {saved} of them saved in part or whole.")
