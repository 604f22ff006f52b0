"""Watch a flight: in a window where there is a screen, else on a page with its film and every trace beside it.

Without a recording the policy flies now. A window shows seed after seed until it is closed; a page, a film or a file
for rerun shows one flight, whose recording is kept beside it.

Example: aerial-il view robot=ua_quad_arm4 task=pick_place
Example: aerial-il view policy=runs/pick_bc tier=gusts seed=10003 out=failure.html
Example: aerial-il view recording=datasets/pick seed=3 viewer=rerun
Example: aerial-il view recording=datasets/pick seed=3 out=flight.png size=[1080,1920]
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerial_il.cli.configuration.keys import Located, Named, TierName, at_least, check_choices, group, key, path
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv

VIEWS = "runs/views"
SUFFIXES = {".html": "page", ".mp4": "film", ".rrd": "rerun", ".png": "still"}
ENDINGS = {viewer: suffix for suffix, viewer in SUFFIXES.items()}


@dataclass
class Config:
    policy: Located = path(Located, "pilot: expert, random, hover, or the folder of a policy", value="expert")
    robot: Named | None = group("robot that flies (null: the one that the policy was trained on)")
    task: Named | None = group("task that it does (null: the task that the policy was trained on)")
    tier: TierName = group("disturbance tier, e.g. gusts, hard-payload, calm+latency", "calm", composed=True)
    env: str | None = key(None, "external environment, e.g. gymnasium:Hopper-v5 (null: the policy's own)")
    controller: Named = group("control law of the base", "geometric_observer")
    action: str | None = key(None, "action level (null: the policy's own, ee_pose for the others)")
    seed: int | None = key(None, "of the flight, or which episode of a dataset (null: the first)")
    recording: str | None = key(None, "an MCAP file, or a dataset, to watch instead of flying")
    viewer: str = key(
        "auto",
        "auto: a window where there is a screen, else a page; rerun: its viewer, or a file for it where no screen is; "
        "still: the flight in one picture",
        choices=("auto", "window", "page", "film", "rerun", "still"),
    )
    out: str | None = key(
        None, f"where it goes (.html, .mp4, .rrd or .png decide the viewer); below {VIEWS} by default"
    )
    size: list[int] = key([720, 1280], "height and width of a still")
    progress: bool = key(True, "show a progress bar while the film is made")

    def __post_init__(self) -> None:
        check_choices(self)
        at_least(self, seed=0)
        if self.recording and (self.robot or self.task or self.policy.path != "expert"):
            raise InvalidValueError("recording=... determines who flies what: leave out robot=, task= and policy=.")
        if self.out:
            self._take_viewer_of_out(self.out)

    def _take_viewer_of_out(self, out: str) -> None:
        meant = SUFFIXES.get(Path(out).suffix)
        if meant is None:
            raise InvalidValueError(f"out={out} must end in one of {', '.join(SUFFIXES)}.")
        if self.viewer not in ("auto", meant):
            raise InvalidValueError(f"out={out} is for viewer={meant}, not for viewer={self.viewer}.")
        self.viewer = meant

    @property
    def still_size(self) -> tuple[int, int]:
        """Height and width of a still, pixels."""
        if len(self.size) != 2:
            raise InvalidValueError(f"size={self.size} is no height and width, e.g. size=[1080,1920].")
        return self.size[0], self.size[1]


def run(config: Config) -> None:
    """Show the flight, and say where it went."""
    from aerial_il.presentation.films.window import has_screen

    viewer = config.viewer
    if viewer == "auto":
        viewer = "window" if has_screen() else "page"
        if viewer == "page":
            print("No screen here: a page instead.")
    if config.recording:
        file = _find(Path(config.recording), config.seed)
        _show_recording(config, viewer, file)
    else:
        _show_flight(config, viewer)


def _show_flight(config: Config, viewer: str) -> None:
    from aerial_il.presentation.films import window
    from aerial_il.workflows.parts import pilots

    pilot = pilots.pilot(
        config.policy.path,
        robot=config.robot.name if config.robot else None,
        task=config.task.name if config.task else None,
        action=config.action,
        env=config.env,
    )
    law, seed = config.controller.name, config.seed or 0
    env = pilot.environment(config.tier.name, num_envs=1, threads=1, controller=law)
    try:
        if viewer == "window":
            print(f"{pilot.task} on {pilot.robot} from seed {seed} on. Close the window to end.")
            window.show_live(env, pilot.policy, seed)
            return
        out = _out(
            config, viewer, f"{pilot.task}-{pilot.robot}-{config.tier.name}-{seed}-{Path(config.policy.path).name}"
        )
        file = out.with_suffix(".mcap")
        episode = pilots.record(env, pilot.policy, seed, file, name=config.policy.path)
        again = command_line(
            ["view", *pilot.overrides, f"tier={config.tier.name}", f"controller={law}", f"seed={seed}"]
        )
        _present(config, viewer, episode, file, out, env=env, again=again)
    finally:
        env.close()
    print(f"Recording: {file}")


def _show_recording(config: Config, viewer: str, file: Path) -> None:
    from aerial_il.data.recording.reader import read_episode
    from aerial_il.presentation.films import window
    from aerial_il.workflows.parts.scenes import same_scene

    episode = read_episode(file)
    if viewer == "window":
        print(f"{file}: again and again. Close the window to end.")
        window.show_recording(episode)
        return
    env = same_scene(episode)
    try:
        again = command_line(["view", f"recording={file}"])
        _present(config, viewer, episode, file, _out(config, viewer, file.stem), env=env, again=again)
    finally:
        if env is not None:
            env.close()


def _present(
    config: Config, viewer: str, episode: Any, file: Path, out: Path, *, env: BatchEnv | None, again: str
) -> None:
    """Write what shows one flight without a window, or hand it to rerun."""
    from aerial_il.evaluation.outcome import subtask_flags
    from aerial_il.presentation.films.video import end_of
    from aerial_il.suite.batch import BatchEnvironment

    print(f"{episode.spec.task} on {episode.spec.robot}: {end_of(episode)} after {episode.sim_time[-1]:.2f} s.")
    if viewer == "rerun":
        _rerun(file, out)
        return
    if viewer == "still":
        _still(config, episode, out)
        return
    flags = subtask_flags(env, episode) if isinstance(env, BatchEnvironment) else None
    if viewer == "film":
        _film(config, episode, out, flags)
    else:
        _page(config, episode, file, out, flags, again)


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


def _still(config: Config, episode: Any, out: Path) -> None:
    from aerial_il.core.rendering import RenderingError
    from aerial_il.presentation.films.scene_renderer import obstacle
    from aerial_il.presentation.films.stroboscope import write_stroboscope

    if problem := obstacle():
        raise RenderingError(f"No picture: {problem} viewer=page shows the traces without it.")
    print(f"Picture: {write_stroboscope(out, episode, size=config.still_size)}")


def _film(config: Config, episode: Any, out: Path, flags: Any) -> None:
    from aerial_il.core.rendering import RenderingError
    from aerial_il.presentation.films.scene_renderer import obstacle
    from aerial_il.presentation.films.video import film_recording

    if problem := obstacle():
        raise RenderingError(f"No film: {problem} viewer=page shows the traces without it.")
    print(f"Film: {film_recording(episode, out, flags=flags, progress=config.progress)}")


def _page(config: Config, episode: Any, file: Path, out: Path, flags: Any, again: str) -> None:
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
            film_recording(episode, film, flags=flags, progress=config.progress)
        page = write_player(out, episode, flags=flags, film=film, note=" ".join(notes), commands=commands)
    print(f"Page: {page}")


def _fly_this(episode: Any) -> list[str]:
    """Return the command by which a person flies the same robot, task, air and start; none for strangers' worlds."""
    spec = episode.spec
    if spec.is_outside:
        return []
    cell = [f"robot={spec.robot}", f"task={spec.task}", f"tier={spec.tier}", f"controller={spec.controller}"]
    return [command_line(["teleop", *cell, f"seed={episode.seed}", f"out=datasets/{spec.task}_by_hand"])]


def _out(config: Config, viewer: str, name: str) -> Path:
    return Path(config.out) if config.out else Path(VIEWS) / f"{name}{ENDINGS[viewer]}"


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
    chosen = [file for file in files if seed is None or f"-{seed:06d}-" in file.name]
    if not chosen:
        seeds = sorted(int(file.stem.split("-")[-2]) for file in files)
        raise DemoError(place, f"has no episode with seed {seed}.", hint=f"Seeds from {seeds[0]} to {seeds[-1]}.")
    return chosen[0]
