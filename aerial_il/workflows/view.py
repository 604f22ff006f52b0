"""One flight to watch: in a window, on a page with every trace, as a film, a picture, or in rerun."""

from __future__ import annotations

from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.places import claim_file
from aerial_il.workflows.parts.names import Controller, MaybeRobot, MaybeTask, Tier, at_least
from aerial_il.workflows.spelling import command_line

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv

VIEWS = "runs/views"
SUFFIXES = {".html": "page", ".mp4": "film", ".rrd": "rerun", ".png": "still"}
ENDINGS = {viewer: suffix for suffix, viewer in SUFFIXES.items()}


@dataclass(frozen=True, kw_only=True)
class View:
    """What is watched, and how.

    Attributes:
        policy: pilot: expert, random, hover, or the folder of a policy.
        robot: robot that flies (null: the one that the policy was trained on).
        task: task that it does (null: the task that the policy was trained on).
        tier: disturbance tier, e.g. gusts, hard-payload, calm+latency.
        env: external environment, e.g. gymnasium:Hopper-v5 (null: the policy's own).
        controller: control law of the base.
        action: action level (null: the policy's own, ee_pose for the others).
        seed: of the flight, or which episode of a dataset (null: the first).
        recording: an MCAP file, or a dataset, to watch instead of flying.
        viewer: auto: a window where there is a screen, else a page; rerun: its viewer, or a file for it where no screen
            is; still: the flight in one picture.
        out: where it goes (.html, .mp4, .rrd or .png decide the viewer); below runs/views by default.
        size: height and width of a still.
        progress: show a progress bar while the film is made.
    """

    policy: str = "expert"
    robot: MaybeRobot = None
    task: MaybeTask = None
    tier: Tier = "calm"
    env: str | None = None
    controller: Controller = "geometric_observer"
    action: str | None = None
    seed: int | None = None
    recording: str | None = None
    viewer: Literal["auto", "window", "page", "film", "rerun", "still"] = "auto"
    out: str | None = None
    size: tuple[int, int] = (720, 1280)
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, seed=0)
        if self.recording and (self.robot or self.task or self.policy != "expert"):
            raise InvalidValueError("recording=... determines who flies what: leave out robot=, task= and policy=.")
        meant = self._of_out
        if self.out and meant is None:
            raise InvalidValueError(f"out={self.out} must end in one of {', '.join(SUFFIXES)}.")
        if meant is not None and self.viewer not in ("auto", meant):
            raise InvalidValueError(f"out={self.out} is for viewer={meant}, not for viewer={self.viewer}.")

    @property
    def _of_out(self) -> str | None:
        return SUFFIXES.get(Path(self.out).suffix) if self.out else None

    @property
    def by(self) -> str:
        """The viewer, as it was said or as ``out`` ends."""
        return self._of_out or self.viewer


def view(settings: View) -> None:
    """Show the flight, and say where it went."""
    from aerial_il.presentation.films.window import has_screen

    viewer = settings.by
    if viewer == "auto":
        viewer = "window" if has_screen() else "page"
        if viewer == "page":
            print("No screen here: a page instead.")
    if settings.recording:
        _show_recording(settings, viewer, _find(Path(settings.recording), settings.seed))
    else:
        _show_flight(settings, viewer)


def _show_flight(settings: View, viewer: str) -> None:
    from aerial_il.presentation.films import window
    from aerial_il.workflows.parts import environments, pilots

    pilot = pilots.pilot(
        settings.policy,
        robot=settings.robot,
        task=settings.task,
        action=settings.action,
        env=settings.env,
    )
    environments.refuse_unread(pilot.reference.env, settings, ("tier", "controller"))
    law, seed = settings.controller, settings.seed or 0
    with closing(pilot.environment(settings.tier, num_envs=1, threads=1, controller=law)) as env:
        if viewer == "window":
            print(f"{pilot.task} on {pilot.robot} from seed {seed} on. Close the window to end.")
            window.show_live(env, pilot.policy, seed)
            return
        out = _out(settings, viewer, f"{pilot.task}-{pilot.robot}-{settings.tier}-{seed}-{Path(settings.policy).name}")
        file = claim_file(out.with_suffix(".mcap"))
        episode = pilots.record(env, pilot.policy, seed, file, name=settings.policy)
        again = command_line(["view", *pilot.overrides, f"tier={settings.tier}", f"controller={law}", f"seed={seed}"])
        _present(settings, viewer, episode, file, out, env=env, again=again)
    print(f"Recording: {file}")


def _show_recording(settings: View, viewer: str, file: Path) -> None:
    from aerial_il.data.recording.reader import read_episode
    from aerial_il.presentation.films import window
    from aerial_il.workflows.parts.scenes import same_scene

    episode = read_episode(file)
    if viewer == "window":
        print(f"{file}: again and again. Close the window to end.")
        window.show_recording(episode)
        return
    env, again = same_scene(episode), command_line(["view", f"recording={file}"])
    with closing(env) if env else nullcontext():
        _present(settings, viewer, episode, file, _out(settings, viewer, file.stem), env=env, again=again)


def _present(
    settings: View, viewer: str, episode: Any, file: Path, out: Path, *, env: BatchEnv | None, again: str
) -> None:
    """Write what shows one flight without a window, or hand it to rerun."""
    from aerial_il.core.rendering import RenderingError
    from aerial_il.evaluation.outcome import subtask_flags
    from aerial_il.presentation.films.scene_renderer import obstacle
    from aerial_il.presentation.films.stroboscope import write_stroboscope
    from aerial_il.presentation.films.video import end_of, film_recording
    from aerial_il.suite.batch import BatchEnvironment

    print(f"{episode.spec.task} on {episode.spec.robot}: {end_of(episode)} after {episode.sim_time[-1]:.2f} s.")
    if viewer == "rerun":
        _rerun(file, out)
        return
    if viewer != "page" and (problem := obstacle()):
        raise RenderingError(f"Nothing can be drawn: {problem} viewer=page shows the traces without it.")
    if viewer == "still":
        print(f"Picture: {write_stroboscope(out, episode, size=settings.size)}")
        return
    flags = subtask_flags(env, episode) if isinstance(env, BatchEnvironment) else None
    if viewer == "film":
        print(f"Film: {film_recording(episode, out, flags=flags, progress=settings.progress)}")
    else:
        _page(settings, episode, file, out, flags, again)


def _rerun(file: Path, out: Path) -> None:
    from aerial_il.presentation.films.window import has_screen
    from aerial_il.presentation.rerun import program

    if has_screen():
        program.open_window(file)
        print(f"rerun shows {file}")
    else:
        out.parent.mkdir(parents=True, exist_ok=True)
        program.run("mcap", "convert", str(file), "-o", str(out))
        print(f"No screen here. On a machine with one: rerun {out}")


def _page(settings: View, episode: Any, file: Path, out: Path, flags: Any, again: str) -> None:
    from tempfile import TemporaryDirectory

    from aerial_il.presentation.films.scene_renderer import obstacle
    from aerial_il.presentation.films.video import film_recording
    from aerial_il.presentation.pages.player import write_player

    problem = obstacle()
    notes = [f"No film: {problem}"] if problem else []
    if flags is None:
        notes.append("The scene has changed since this was recorded: its sub-tasks cannot be judged.")
    for note in notes:
        print(note)
    seen = command_line(["view", f"recording={file}", "viewer=rerun"])
    commands = [again, seen, command_line(["replay", f"path={file}"]), *_fly_this(episode)]
    with TemporaryDirectory() as folder:
        film = None if problem else Path(folder) / "film.mp4"
        if film:
            film_recording(episode, film, flags=flags, progress=settings.progress)
        page = write_player(out, episode, flags=flags, film=film, note=" ".join(notes), commands=commands)
    print(f"Page: {page}")


def _fly_this(episode: Any) -> list[str]:
    """Return the command by which a person flies the same robot, task, air and start, if it is of the suite."""
    spec = episode.spec
    if spec.is_outside:
        return []
    cell = [f"robot={spec.robot}", f"task={spec.task}", f"tier={spec.tier}", f"controller={spec.controller}"]
    return [command_line(["teleop", *cell, f"seed={episode.seed}", f"out=datasets/{spec.task}_by_hand"])]


def _out(settings: View, viewer: str, name: str) -> Path:
    return claim_file(settings.out or Path(VIEWS) / f"{name}{ENDINGS[viewer]}")


def _find(place: Path, seed: int | None) -> Path:
    """Return the MCAP file meant by ``recording=`` and ``seed=``."""
    from aerial_il.core.errors import DemoError
    from aerial_il.data.folder import KINDS, DatasetFolder

    if place.is_file() and place.suffix == ".mcap":
        return place
    if place.is_file():
        raise DemoError(place, "is not an MCAP recording, and holds no states to show.")
    if not place.exists():
        raise DemoError(place, "does not exist.", hint="Record some with: aerial-il collect robot=R task=T out=PATH")
    files = [file for kind in KINDS for file in DatasetFolder(place).files(kind)] or sorted(place.glob("*.mcap"))
    if not files:
        raise DemoError(place, "holds no MCAP recordings.", hint=f"See what it holds: aerial-il info {place}")
    if seed is None:
        return files[0]
    seeds = {file: _seed_of(file) for file in files}
    for file, flown in seeds.items():
        if flown == seed:
            return file
    known = sorted(each for each in seeds.values() if each is not None)
    hint = f"Seeds from {known[0]} to {known[-1]}." if known else f"See what it holds: aerial-il info {place}"
    raise DemoError(place, f"has no episode with seed {seed}.", hint=hint)


def _seed_of(file: Path) -> int | None:
    """Return the seed of a recording: by its name, as datasets have it, or else as it says."""
    from aerial_il.data.recording.reader import read_origin

    told = file.stem.rsplit("-", 2)[1:-1]
    return int(told[0]) if told and len(told[0]) >= 6 and told[0].isdecimal() else read_origin(file).get("seed")
