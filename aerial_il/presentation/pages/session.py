"""A page about a folder that people fly into: its episodes with pictures, their length and smoothness, by operator."""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DEMOS, FAILURES, DatasetFolder
from aerial_il.data.provenance import HUMAN
from aerial_il.data.recording.reader import read_episode
from aerial_il.presentation.films.scene_renderer import SceneRenderer, obstacle
from aerial_il.presentation.films.video import jpeg
from aerial_il.presentation.pages.charts import Figure, histogram
from aerial_il.presentation.pages.page import data_of, page_text
from aerial_il.presentation.studio.studio import QUICK

log = logging.getLogger(__name__)
PAGE = "session.html"
MOST_PICTURES = 60  # of the episodes recorded last, so that the page stays small
SHARES = (0.0, 0.5, 1.0)  # of an episode, of which pictures are shown
THUMBNAIL = (132, 176)  # height and width, pixels
QUALITY = 70
OUTCOMES = {"solved": True, "not solved": False}


@dataclass(frozen=True)
class Take:
    """One recorded episode.

    Attributes:
        uid: its name. seed: its start. operator: who flew. success: whether the task was solved.
        length_s: of simulated time. jerk: root mean square of the tool's third derivative, m/s³; NaN without a tool.
        time_scale: how fast time passed for the operator. corrected: share of steps in which a person had taken over.
        note: what is special about it. pictures: JPEGs as addresses; none for older ones.
    """

    uid: str
    seed: int
    operator: str
    success: bool
    length_s: float
    jerk: float
    time_scale: float
    corrected: float
    note: str
    pictures: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """Episodes of one operator, summed up: medians of lengths and jerks of those that were solved."""

    operator: str
    demos: int
    failures: int
    length_s: float
    jerk: float
    total_s: float


def _readable(file: Path) -> Episode | None:
    """Return the episode of a recording, or nothing, with a word, where it is damaged."""
    try:
        return read_episode(file)
    except DemoError as error:
        log.warning("%s It is left out of the page.", error)
        return None


def session_page(folder: str | os.PathLike[str], commands: Sequence[str] = ()) -> str:
    """Return the page about a dataset folder, complete in itself.

    Args:
        folder: its place. commands: what a reader types to go on from here.

    Raises:
        DemoError: the folder holds no recording.
    """
    place = DatasetFolder(folder)
    files = sorted(
        (file for kind in (DEMOS, FAILURES) for file in place.files(kind)),
        key=lambda file: file.stat().st_mtime,
        reverse=True,
    )
    if not files:
        hint = f"Fly some: aerial-il teleop robot=R task=T out={folder}"
        raise DemoError(folder, "holds no recording to summarise.", hint=hint)
    episodes = [episode for file in files if (episode := _readable(file)) is not None]
    if not episodes:
        raise DemoError(folder, "holds no recording that can be read.", hint=f"See: aerial-il validate {folder}")
    pictures = thumbnails(episodes[:MOST_PICTURES])
    takes = [take_of(each, shown) for each, shown in zip(episodes, pictures, strict=False)]
    takes += [take_of(each) for each in episodes[MOST_PICTURES:]]
    trash = len(list((place.path / "trash").glob("*/*.mcap")))
    return page_text(
        "session.html.j2",
        spec=episodes[0].spec,
        name=Path(folder).name,
        folder=str(folder),
        takes=takes,
        rows=rows_of(takes),
        trash=trash,
        lengths=lengths(takes),
        commands=commands,
        shown=min(len(takes), MOST_PICTURES),
    )


def take_of(episode: Episode, pictures: Sequence[str] = ()) -> Take:
    """Sum up one episode."""
    origin, settings = episode.provenance, episode.provenance.get("settings") or {}
    return Take(
        uid=episode.uid,
        seed=episode.seed,
        operator=operator_of(str(origin.get("policy", ""))),
        success=bool(episode.success),
        length_s=float(episode.sim_time[-1] - episode.sim_time[0]),
        jerk=tool_jerk(episode),
        time_scale=float(settings.get("time_scale", 1.0)),
        corrected=float(np.mean(episode.is_intervention)) if len(episode) else 0.0,
        note=str(origin.get("note", "")),
        pictures=tuple(pictures),
    )


def operator_of(policy: str) -> str:
    """Return who flew: ``human:ada`` is ada; a script flies under its own name."""
    return policy.rpartition(HUMAN)[2] or policy or "unknown"


def tool_jerk(episode: Episode) -> float:
    """Return the root mean square, over an episode, of the third difference quotient of the tool's place, m/s³."""
    if "ee_pos" not in episode.obs or len(episode.obs["ee_pos"]) < 4:
        return float("nan")
    jerk = np.diff(episode.obs["ee_pos"], n=3, axis=0) / episode.spec.control_dt_s**3
    return float(np.sqrt(np.mean(np.sum(jerk**2, axis=1))))


def rows_of(takes: Sequence[Take]) -> list[Row]:
    """Return one row for each operator, who has flown most first."""
    names = sorted({take.operator for take in takes}, key=lambda name: -sum(t.operator == name for t in takes))
    return [_row(name, [take for take in takes if take.operator == name]) for name in names]


def lengths(takes: Sequence[Take]) -> Figure:
    """Draw a histogram of the lengths of what was solved and of what was not."""
    groups = {name: [take.length_s for take in takes if take.success is won] for name, won in OUTCOMES.items()}
    kinds = {name: "good" if won else "bad" for name, won in OUTCOMES.items()}
    return histogram("Length", groups, x_label="s", kinds=kinds)


def thumbnails(episodes: Sequence[Episode]) -> list[tuple[str, ...]]:
    """Return small pictures of the beginning, middle and end of episodes; none where nothing can be drawn."""
    if obstacle() or not all(episode.states.size for episode in episodes):
        return [()] * len(episodes)
    with SceneRenderer(episodes[0].model_xml) as renderer:
        return [_pictures(renderer, episode) for episode in episodes]


def _pictures(renderer: SceneRenderer, episode: Episode) -> tuple[str, ...]:
    states = [episode.states[round(share * (len(episode.states) - 1))] for share in SHARES]
    view = renderer.frame(states, THUMBNAIL[1] / THUMBNAIL[0])
    drawn = (renderer.draw(state, view, *THUMBNAIL, exposures=QUICK) for state in states)
    return tuple(data_of(jpeg(image, QUALITY), ".jpg") for image in drawn)


def _row(name: str, takes: Sequence[Take]) -> Row:
    solved = [take for take in takes if take.success]
    length, jerk = (_median([getattr(take, field) for take in solved]) for field in ("length_s", "jerk"))
    return Row(name, len(solved), len(takes) - len(solved), length, jerk, sum(take.length_s for take in takes))


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else float("nan")
