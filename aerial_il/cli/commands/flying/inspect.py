"""Look at flights in rerun: the real scene in motion, its forces and pictures, and every signal on one timeline.

A dataset opens with all of its flights, a run with its policy flying now. Two things are shown side by side, on a
timeline on which their phases fall together.

Example: aerial-il inspect datasets/pick episode=3
Example: aerial-il inspect datasets/pick runs/pick episode=3 save=compared.rrd
Example: aerial-il inspect datasets/pick episode=0 policy=runs/pick screenshot=chunks.png at=0.5
"""

from pathlib import Path

from aerial_il.workflows.inspect import Inspect, inspect

SETTINGS, BARE = Inspect, ("path", "beside")


def run(settings: Inspect) -> None:
    """Write the file, and show it as far as this machine can."""
    seen = inspect(settings)
    for note in seen.notes:
        print(note)
    print(f"{seen.file}: {seen.file.stat().st_size / 1e6:.1f} MB")
    if seen.picture is not None:
        print(f"Picture: {seen.picture}")
    _show(settings, seen.file)


def _show(settings: Inspect, target: Path) -> None:
    """Open a window or a page, or say how."""
    from aerial_il.presentation.films.window import has_screen
    from aerial_il.presentation.rerun import program

    if settings.web:
        data_port = settings.port + 1 if settings.port else 0
        with program.page(target, port=settings.port, data_port=data_port) as (server, address):
            print(f"Open {address}\nCtrl-C ends it.", flush=True)
            server.wait()
    elif has_screen() and not (settings.save or settings.screenshot):
        program.open_window(target)
        print("rerun shows it.")
    elif not (settings.save or settings.screenshot):
        print(f"No screen here. On a machine with one: rerun {target}; or serve a page with web=true")
