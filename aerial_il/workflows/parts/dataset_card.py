"""What the card of a dataset needs beside its numbers: films of outliers, lines that load it, a place."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.progress import Progress

if TYPE_CHECKING:
    from aerial_il.data.episode import Episode
    from aerial_il.data.summary import Summary
    from aerial_il.presentation.pages.card import Film

PAGE = "card.html"


def place_of(path: Path) -> Path:
    """Return where the page about a dataset goes: into a folder of ours or of LeRobot's, beside anything else."""
    from aerial_il.data.folder import DatasetFolder
    from aerial_il.data.formats import lerobot

    if path.is_dir() and (lerobot.recognises(path) or DatasetFolder(path).spec() is not None):
        return path / PAGE
    return path.with_name(f"{path.resolve().stem}-{PAGE}")


def loading(path: str) -> list[str]:
    """Return the Python that opens a dataset here."""
    opened = f"dataset = aerial_il.open_dataset({json.dumps(path)})"
    return ["import aerial_il", opened, "episode = dataset[0]  # its obs, actions, rewards, success"]


def lerobot_loading(repo: str | None, path: Path) -> list[str]:
    """Return the Python that opens a LeRobot dataset: the one of a hub, or where there is none, the folder."""
    named = json.dumps(repo) if repo else f"{json.dumps(f'local/{path.name}')}, root={json.dumps(str(path))}"
    first = "from lerobot.datasets.lerobot_dataset import LeRobotDataset"
    return [first, f"dataset = LeRobotDataset({named})", 'action = dataset[0]["action"]']


def films_of(
    path: str, summary: Summary, most: int, *, answers: Mapping[str, Any], progress: bool
) -> tuple[list[Film], str]:
    """Return films of at most so many outliers, and why there are none or fewer.

    Args:
        path: of the dataset. summary: of it. most: films. answers: how it is read. progress: show a progress bar.
    """
    from aerial_il.data.dataset import open_dataset
    from aerial_il.presentation.films.scene_renderer import obstacle

    wanted = summary.outliers[:most]
    if not wanted:
        return [], ""
    if problem := obstacle():
        return [], f"No films: {problem}"
    films, dataset = list[Any](), open_dataset(path, **answers, failures=True)
    for row in Progress(wanted, desc="films", unit="film", disable=not progress):
        try:
            films.append(_film(dataset[row["uid"]], str(row["suspect"])))
        except AerialError as error:
            return films, f"{'No' if not films else 'Not all'} films: {error}"
    return films, ""


def _film(episode: Episode, why: str) -> Film:
    from aerial_il.presentation.films.clips import short_film
    from aerial_il.presentation.pages.card import Film
    from aerial_il.presentation.pages.page import data_uri

    if not episode.states.size or not episode.model_xml:
        raise InvalidValueError("it keeps no scene or no states of a simulator, from which they are made.")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        speed = short_film(episode, file)
        return Film(episode.uid, data_uri(file), speed, why)


def onward(path: str, files: Sequence[Path]) -> list[str]:
    """Return what a reader types to go on from a dataset of ours; nothing for one of others."""
    from aerial_il.workflows.spelling import command_line

    if not files:
        return []
    words = [
        ["validate", path],
        ["browse", path],
        ["train", f"dataset={path}", f"run=runs/{Path(path).resolve().name}"],
    ]
    return [command_line(each) for each in words]
