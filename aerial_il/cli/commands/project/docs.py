"""Build the documentation: guides, reference, robots, tasks and studies as one site that opens offline.

The pages of robots and tasks are written into the repository, where they are read too; the site is written anew from
all its pages. A second build takes only what has changed.

Example: aerial-il docs open=true
Example: aerial-il docs site=null films=true
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import key

NOWHERE = ("null", "false", "")  # a path is taken as it stands, these words too
FRAMES_OF = "fa_hexa_arm4"  # whose picture shows the frames


@dataclass
class Config:
    out: str | None = key("docs", "folder that gets robots/NAME.md with a drawing, and tasks/NAME.md; null for none")
    films: bool = key(False, "also make their pictures and clips anew, of an expert's flight each (minutes)")
    site: str | None = key("build/site", "folder of the site; null for none")
    open: bool = key(False, "open the site in a browser, or say how where there is no screen")
    strict: bool = key(True, "a warning about a page is an error")

    def __post_init__(self) -> None:
        self.out = None if self.out in NOWHERE else self.out
        self.site = None if self.site in NOWHERE else self.site


def run(config: Config) -> None:
    """Write what is asked for and say where."""
    if config.site and not Path(config.site).exists():
        print("Building the site takes about 30 s of processor time; a second time takes 10.", flush=True)
    if config.out:
        for path in write_pages(config.out, films=config.films):
            print(path)
    if config.site:
        from aerial_il.cli import reference
        from aerial_il.presentation.documentation.site import build

        start = build(config.site, reference.pages(), strict=config.strict, quiet=True)
        print(f"Site: {start}")
        if config.open:
            show(start)


def write_pages(folder: str, *, films: bool) -> list[Path]:
    """Write the pages of robots and tasks, and return their files."""
    from aerial_il.presentation.pages import robot_pages, task_pages

    pictures = write_films(Path(folder)) if films else []
    return [*pictures, *write_drawings(folder), *robot_pages.write_pages(folder), *task_pages.write_pages(folder)]


def write_drawings(folder: str) -> list[Path]:
    """Draw the frames, and where this is a checkout the layers and the results, from the contract and the records."""
    from aerial_il import robots
    from aerial_il.core.files import write_atomic
    from aerial_il.presentation.documentation import layers, results
    from aerial_il.presentation.documentation.sources import ROOT
    from aerial_il.presentation.pages import frames

    drawn = {"frames.svg": frames.drawing(robots.get(FRAMES_OF))}
    if (ROOT / layers.CONTRACT).exists():
        drawn |= {"architecture.svg": layers.drawing(ROOT), "results.svg": results.drawing(ROOT)}
    return [write_atomic(Path(folder) / name, drawing) for name, drawing in drawn.items()]


def write_films(folder: Path) -> list[Path]:
    """Fly every task and every robot once and keep a picture and a clip of each."""
    from tempfile import TemporaryDirectory

    from aerial_il.cli.commands.project.list import catalogue
    from aerial_il.core.rendering import require_rendering
    from aerial_il.presentation.pages.gallery import copy_films, write_gallery
    from aerial_il.workflows.parts.pilots import expert_flight

    require_rendering("films=true")
    with TemporaryDirectory() as place:
        gallery = write_gallery(Path(place) / "gallery.html", catalogue(), fly=expert_flight)
        return copy_films(gallery, folder)


def show(start: Path) -> None:
    """Open the first page where there is a screen; elsewhere say how to look at it from another machine."""
    import webbrowser

    from aerial_il.presentation.films.window import has_screen

    if has_screen() and webbrowser.open(start.as_uri()):
        return
    print(f"No browser here. Serve it: python -m http.server -b 127.0.0.1 -d {start.parent} 8080")
    print("and from your machine: ssh -N -L 8080:127.0.0.1:8080 THIS_MACHINE, then http://127.0.0.1:8080")
