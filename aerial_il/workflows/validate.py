"""Read every recording in full, and say which cannot be trusted, and why."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.workflows.replay import Replayed


@dataclass(frozen=True, kw_only=True)
class Validate:
    """What is checked.

    Attributes:
        path: dataset, or one file.
        replay: also fly each episode again and require equal states (as aerial-il replay).
        progress: show a progress bar.
    """

    path: str
    replay: bool = False
    progress: bool = True


@dataclass(frozen=True)
class Checked:
    """What a check has shown: how many episodes, what is wrong, and what was flown again."""

    episodes: int
    problems: tuple[str, ...]
    replayed: Replayed | None = None


def validate(settings: Validate) -> Checked:
    """Check, and fly again what is sound where that is wanted."""
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import altered_files, open_dataset
    from aerial_il.workflows.replay import Replay, replay

    dataset = open_dataset(settings.path, cameras=True, failures=True)
    shown = {"total": len(dataset), "desc": "validate", "unit": "ep", "disable": not settings.progress}
    problems = [str(error) for _, error in Progress(dataset.problems(), **shown) if error is not None]
    problems += [f"{file}: differs from what the index lists." for file in altered_files(settings.path)]
    again = Replay(path=settings.path, progress=settings.progress) if settings.replay and not problems else None
    return Checked(len(dataset), tuple(problems), replay(again) if again is not None else None)
