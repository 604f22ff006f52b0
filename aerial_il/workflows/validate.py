"""Read every recording in full, and say which cannot be trusted, and why."""

from dataclasses import dataclass

from aerial_il.data.reading import Reading
from aerial_il.workflows.replay import Replayed


@dataclass(frozen=True, kw_only=True)
class Validate(Reading):
    """What is checked.

    Attributes:
        path: dataset, or one file.
        replay: also fly each episode again and require equal states (as aerial-il replay).
        progress: show a progress bar.
    """

    path: str
    replay: bool = False
    progress: bool = True


@dataclass(frozen=True, kw_only=True)
class Checked:
    """What a check has shown.

    Attributes:
        episodes: how many there are. problems: what is wrong. notes: what is odd, was mended, or is not said.
        replayed: what was flown again.
    """

    episodes: int
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    replayed: Replayed | None


def validate(settings: Validate) -> Checked:
    """Check, and fly again what is sound where that is wanted."""
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import altered_files, open_dataset
    from aerial_il.workflows.replay import Replay, replay

    dataset = open_dataset(settings.path, **settings.answers, cameras=True, failures=True)
    count = len(dataset) + len(dataset.survey.left_out)
    shown = {"total": count, "desc": "validate", "unit": "ep", "disable": not settings.progress}
    problems = [str(error) for _, error in Progress(dataset.problems(), **shown) if error is not None]
    problems += [f"{file}: differs from what the index lists." for file in altered_files(settings.path)]
    again = Replay(path=settings.path, progress=settings.progress) if settings.replay and not problems else None
    return Checked(
        episodes=count,
        problems=tuple(problems),
        notes=tuple(dataset.notes()),
        replayed=replay(again) if again is not None else None,
    )
