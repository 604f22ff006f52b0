"""The documentation: guides, reference, robots, tasks and studies as one site that opens offline."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.places import claim_folder

NOWHERE = ("null", "false", "")  # a path is taken as it stands, these words too
FRAMES_OF = "fa_hexa_arm4"  # whose picture shows the frames


@dataclass(frozen=True, kw_only=True)
class Docs:
    """What is built.

    Attributes:
        out: folder that gets robots/NAME.md with a drawing, and tasks/NAME.md; null for none.
        films: also make their pictures and clips anew, of an expert's flight each, and gallery.png (minutes).
        site: folder of the site; null for none.
        open: open the site in a browser, or say how where there is no screen.
        strict: a warning about a page is an error.
    """

    out: str | None = "docs"
    films: bool = False
    site: str | None = "build/site"
    open: bool = False
    strict: bool = True

    def __post_init__(self) -> None:
        for name in ("out", "site"):
            if getattr(self, name) in NOWHERE:
                object.__setattr__(self, name, None)


def pages(settings: Docs) -> Iterator[Path]:
    """Write the pages of robots and tasks where they are wanted, and yield their files."""
    if settings.out:
        claim_folder(settings.out, ("index.md", "robots/README.md"))
        yield from write_pages(settings.out, films=settings.films)


def site(settings: Docs, reference: Mapping[str, str]) -> Path | None:
    """Build the site where it is wanted, with the pages of ``reference``, and return its first page."""
    from aerial_il.presentation.documentation.site import build

    if not settings.site:
        return None
    claim_folder(settings.site, ("objects.inv",), key="site")
    return build(settings.site, reference, strict=settings.strict, quiet=True)


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
    """Fly every task and every robot once and keep a picture and a clip of each, and a sheet of all pictures."""
    from tempfile import TemporaryDirectory

    from aerial_il.core.rendering import require_rendering
    from aerial_il.presentation.pages.gallery import copy_films, write_gallery, write_sheet
    from aerial_il.workflows.catalogue import catalogue
    from aerial_il.workflows.parts.pilots import expert_flight

    require_rendering("films=true")
    with TemporaryDirectory() as place:
        gallery = write_gallery(Path(place) / "gallery.html", catalogue(), fly=expert_flight)
        return [*copy_films(gallery, folder), write_sheet(folder / "gallery.png", gallery)]
