"""Fly it yourself, on a page in the browser, and record what you fly: keyboard, gamepad or touch.

On a machine without a screen the page is reached through a tunnel; the line to type is printed. Every episode is asked
for before it is kept; what is kept goes to demos/ or failures/ of the folder, what is discarded to its trash/. The same
command goes on with the session where it stopped.

Example: aerial-il teleop robot=fa_hexa_arm4 task=reach out=datasets/reach_by_hand
Example: aerial-il teleop robot=fa_hexa_arm4 task=pick_place tier=gusts time_scale=0.5 out=datasets/pick_by_hand
Example: aerial-il teleop policy=runs/pick out=datasets/pick_rescued
Example: aerial-il teleop devices=[keyboard,spacemouse] out=datasets/by_mouse
"""

from aerial_il.workflows.spelling import command_line, path
from aerial_il.workflows.teleop import Teleop, teleop

SETTINGS, OUTPUT = Teleop, "out"


def run(settings: Teleop) -> None:
    """Fly until interrupted, and say what comes next."""
    kept = teleop(settings)
    if kept is None:
        return
    counted = f"{kept.demos} demonstrations, {kept.failures} failures, {kept.trash} in the trash"
    print(f"\n{settings.out}: {counted}.")
    if kept.summary is not None:
        print(f"Summary: {kept.summary}")
    if kept.demos:
        print(f"Next: {command_line(['validate', path('path', settings.out)])}")
