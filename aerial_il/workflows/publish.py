"""A folder ready for a hub: a LeRobot dataset, its README and a page about it; pushed where that is asked for."""

import re
from dataclasses import dataclass
from os.path import realpath
from pathlib import Path
from typing import get_args

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading
from aerial_il.workflows.parts.names import License, at_least

_REPO = re.compile(r"[A-Za-z0-9][\w.-]{0,95}/[A-Za-z0-9][\w.-]{0,95}", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Publish(Reading):
    """What is published, how and where.

    Attributes:
        dataset: whose successes are published.
        out: folder that becomes the LeRobot dataset, with README.md and card.html.
        license: under which the data may be used; it must be said.
        repo: NAME/SET on the Hugging Face Hub, to which the folder is pushed (null: nowhere); the token is that of
            the environment variable HF_TOKEN.
        private: a new repository is shown to its owner alone.
        cameras: cameras to include (null: all that were recorded; []: states alone).
        films: of suspects and of what is least alike on the page, at most.
        progress: show a progress bar.
    """

    dataset: str
    out: str
    license: License | None = None
    repo: str | None = None
    private: bool = True
    cameras: tuple[str, ...] | None = None
    films: int = 6
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, films=0)
        if self.license not in get_args(License):
            said = f"license={self.license} is none" if self.license else "A licence must be said"
            raise InvalidValueError(f"{said}: license= one of {', '.join(get_args(License))}.")
        if self.repo is not None and not _REPO.fullmatch(self.repo):
            raise InvalidValueError(f"repo={self.repo} is no repository of the hub's: it is written as NAME/SET.")


@dataclass(frozen=True)
class Published:
    """The folder, the page in it, the address it was pushed to if it was, and what a reader should know."""

    folder: Path
    page: Path
    address: str = ""
    note: str = ""


def publish(settings: Publish) -> Published:
    """Write the folder, and push it if a repository is named; the same command goes on where it was interrupted.

    Raises:
        InvalidValueError: the folder holds what is somebody else's; there is no token; the hub refused.
        DemoError: there is nothing to publish.
    """
    from aerial_il.core.files import write_atomic
    from aerial_il.core.places import README_SIGN, is_ours
    from aerial_il.data.curation.derived import lineage_of
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats import lerobot
    from aerial_il.data.formats.parts.lerobot import pushing
    from aerial_il.data.summary import summarise
    from aerial_il.presentation.hub_readme import hub_readme, hub_tags
    from aerial_il.presentation.pages.card import write_card
    from aerial_il.workflows.parts import dataset_card as parts

    if settings.repo:
        pushing.require_reachable()
    out = _whole(settings)
    summary = summarise(open_dataset(settings.dataset, **settings.answers, states=False), progress=settings.progress)
    films, film_note = parts.films_of(
        settings.dataset, summary, settings.films, answers=settings.answers, progress=settings.progress
    )
    title = settings.repo or out.resolve().name
    load = parts.lerobot_loading(settings.repo, out)
    page = write_card(
        out / lerobot.PAGE, summary, name=title, load=load, films=films, film_note=film_note,
        lineage=lineage_of(Path(settings.dataset)),
    )  # fmt: skip
    readme, note, address = out / lerobot.README, "", ""
    if not readme.exists() or is_ours(readme, README_SIGN):
        features = lerobot.features_of(out)
        text = hub_readme(summary, title=title, license=settings.license, load=load, features=features, page=page.name)
        write_atomic(readme, text)
    else:
        note = f"{readme} is yours and left as it is."
    if settings.repo:
        tags = hub_tags(summary, lerobot=False)  # lerobot adds its own
        address = pushing.push(
            out, settings.repo, license=str(settings.license), tags=tags, private=settings.private, readme=readme
        )
    return Published(out, page, address, note)


def _whole(settings: Publish) -> Path:
    """Return the folder once it is the LeRobot dataset of these episodes, and nothing else lies in it."""
    from aerial_il.core.places import claim_file, claim_folder
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats import lerobot
    from aerial_il.workflows.convert import Convert, convert

    out = Path(settings.out)
    if realpath(out) == realpath(settings.dataset):
        raise InvalidValueError(f"out={out} is the dataset itself: name another folder.")
    claim_folder(out, lerobot.PARTS, (*lerobot.PARTS, lerobot.README, lerobot.PAGE))
    claim_file(out / lerobot.PAGE)
    made = Convert(
        path=settings.dataset, out=settings.out, format="lerobot", cameras=settings.cameras, progress=settings.progress,
        **settings.answers,
    )  # fmt: skip
    dataset = open_dataset(settings.dataset, **settings.answers, cameras=made.images)
    return out if lerobot.is_current(dataset, out) else convert(made)
