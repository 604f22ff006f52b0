"""Say which of two pieces of flight is the better one, for many pairs: by script, or by hand on a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from aerial_il.core.checks import require_choice, require_not_negative, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading

if TYPE_CHECKING:
    from aerial_il.data.episode import Episode
    from aerial_il.data.preferences.file import PreferenceFile
    from aerial_il.data.preferences.pairs import Pair
    from aerial_il.workflows.parts.prefer_server import PreferServer

By = Literal["script", "hand"]


@dataclass(frozen=True, kw_only=True)
class Prefer(Reading):
    """What is judged, and by whom.

    Attributes:
        dataset: whose flights are judged, failures too.
        out: file of the preferences, .jsonl; one that is there already is gone on with.
        by: who judges: script, by success and the time to it; or hand, a person on a page.
        pairs: how many; those that the file has an answer to are not judged again.
        length: steps of each segment.
        seed: of the choice of pairs.
        horizon_s: of the script: after how long success counts 1/e of success at once.
        followed: of the script: share of what came after a segment, in place of what was to be expected then.
        margin: of the script: difference of two scores below which the segments are equal.
        flipped: of the script: share of the answers that are turned round.
        port: of the page of by=hand, on this machine alone; 0 for any that is free.
        open: open the page in a browser, where there is a screen.
        progress: show a progress bar.
    """

    dataset: str
    out: str
    by: By = "script"
    pairs: int = 200
    length: int = 64
    seed: int = 0
    horizon_s: float = 10.0
    followed: float = 0.25
    margin: float = 0.01
    flipped: float = 0.0
    port: int = 8644
    open: bool = True
    progress: bool = True

    def __post_init__(self) -> None:
        require_choice(self, "by", By)
        require_positive(self, "pairs", "length", "horizon_s")
        require_not_negative(self, "seed", "margin", "port")
        require_share(self, "followed", "flipped")
        if Path(self.out).suffix != ".jsonl":
            raise InvalidValueError(f"out={self.out} is not a file of preferences: its name must end in .jsonl.")


@dataclass(frozen=True, kw_only=True)
class Preferred:
    """A file of preferences: where it is, and how many say left, right and equal."""

    path: Path
    counts: Mapping[str, int]


def prefer(settings: Prefer, opened: Callable[[PreferServer], None] = lambda server: None) -> Preferred:
    """Judge pairs, and return what the file holds; a page is served until interrupted, once ``opened`` was told where.

    Raises:
        InvalidValueError: episodes are shorter than a segment, ``out`` is somebody else's, or the port is taken.
        DemoError: the file is damaged or about another dataset, or there is nothing to judge.
    """
    from aerial_il.core.places import claim_file
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.preferences.file import PreferenceFile
    from aerial_il.data.preferences.pairs import draw_pairs

    claim_file(settings.out)
    dataset = open_dataset(settings.dataset, **settings.answers, failures=True, states=False)
    episodes = list(Progress(dataset, desc="read", unit="ep", total=len(dataset), disable=not settings.progress))
    lengths = {episode.uid: len(episode) for episode in episodes}
    pairs = draw_pairs(lengths, settings.pairs, length=settings.length, seed=settings.seed)
    with PreferenceFile(settings.out, lengths) as file:
        if settings.by == "script":
            _judge(settings, episodes, pairs, file)
        else:
            _serve(settings, pairs, file, opened)
        return Preferred(path=Path(settings.out), counts=Counter(each.preferred for each in file.preferences))


def _judge(settings: Prefer, episodes: Sequence[Episode], pairs: Sequence[Pair], file: PreferenceFile) -> None:
    """Let the script judge those of the pairs that the file says nothing of yet."""
    from aerial_il.data.preferences.judge import ScriptedJudge

    judge = ScriptedJudge(
        horizon_s=settings.horizon_s,
        followed=settings.followed,
        margin=settings.margin,
        flipped=settings.flipped,
        seed=settings.seed,
    )
    said = {preference.pair for preference in file.preferences}
    for preference in judge.judge(episodes, [pair for pair in pairs if pair not in said]):
        file.add(preference)


def _serve(
    settings: Prefer, pairs: Sequence[Pair], file: PreferenceFile, opened: Callable[[PreferServer], None]
) -> None:
    """Serve the page until interrupted."""
    from aerial_il.workflows.parts.prefer_server import PreferServer

    with PreferServer(settings.dataset, pairs, file, settings.port) as server:
        opened(server)
        server.serve_forever()
