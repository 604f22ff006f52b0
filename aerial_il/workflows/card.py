"""A page about a dataset, and the README by which a hub shows it."""

from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading
from aerial_il.workflows.parts.names import License, at_least


@dataclass(frozen=True, kw_only=True)
class Card(Reading):
    """What the page is about, and where it goes.

    Attributes:
        path: dataset in any format that is read; failures of a folder of recordings are counted, too.
        out: the page, .html; card.html in a folder of recordings or of LeRobot's, beside any other by default.
        readme: write the hub's README, .md, too (null: README.md of a LeRobot dataset, none of another).
        license: of the data, for the README (null: the one that it states already, if any).
        films: of suspects and of what is least alike, at most.
        progress: show a progress bar.
    """

    path: str
    out: str | None = None
    readme: str | None = None
    license: License | None = None
    films: int = 6
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, films=0)


@dataclass(frozen=True)
class CardFiles:
    """What was written: the page, the README if any, and what a reader should know."""

    page: Path
    readme: Path | None = None
    note: str = ""


def card(settings: Card) -> CardFiles:
    """Write the page, and the README where one is wanted.

    Raises:
        InvalidValueError: a place is somebody else's. DemoError: there is nothing to read.
    """
    from aerial_il.core.files import write_atomic
    from aerial_il.core.places import README_SIGN, claim_file, is_ours
    from aerial_il.data.curation.derived import lineage_of
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats import lerobot
    from aerial_il.data.summary import summarise
    from aerial_il.presentation.hub_readme import hub_readme, stated_license
    from aerial_il.presentation.pages.card import write_card
    from aerial_il.workflows.parts import dataset_card as parts

    path, note = Path(settings.path), ""
    if settings.out is not None and Path(settings.out).suffix != ".html":
        raise InvalidValueError(f"out={settings.out} is to be a page: let its name end in .html.")
    dataset = open_dataset(path, **settings.answers, failures=True, states=False)
    out, of_hub = claim_file(settings.out or parts.place_of(path)), lerobot.recognises(path)
    readme = Path(settings.readme) if settings.readme else path / lerobot.README if of_hub else None
    if readme and not settings.readme and readme.exists() and not is_ours(readme, README_SIGN):
        readme, note = None, f"{readme} is somebody else's and left alone; readme=PATH writes another."
    if readme:
        claim_file(readme, key="readme", sign=README_SIGN)
    summary = summarise(dataset, progress=settings.progress)
    films, film_note = parts.films_of(
        settings.path, summary, settings.films, answers=settings.answers, progress=settings.progress
    )
    load = parts.loading(settings.path)
    page = write_card(
        out, summary, name=settings.path, load=load, films=films, film_note=film_note,
        lineage=lineage_of(dataset.path), commands=parts.onward(settings.path, [*dataset.files.values()]),
    )  # fmt: skip
    if readme:
        lines = parts.lerobot_loading(None, path) if of_hub else load
        beside = page.name if page.resolve().parent == readme.resolve().parent else ""
        title, features = path.resolve().name, lerobot.features_of(path) if of_hub else None
        license = settings.license or stated_license(readme)
        text = hub_readme(summary, title=title, license=license, load=lines, features=features, page=beside)
        write_atomic(readme, text)
    return CardFiles(page, readme, note)
