"""A flight can be watched on a page whose charts move with the film, and in a window."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.data.episode import Episode
from aerial_il.presentation.films import video, window
from aerial_il.presentation.pages.player import write_player
from aerial_il.presentation.pages.trace_plots import trace_plots
from tests.presentation.browser import dom_after, needs_browser
from tests.presentation.conftest import Flown
from tests.presentation.outline import Outline, needs_nothing_else


@pytest.fixture(scope="module")
def page(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("player") / "flight.html"
    return write_player(path, flown.episode, flags=flown.flags, note="No film here.", commands=["aerial-il list"])


def test_sub_tasks_follow_from_recorded_states(flown: Flown) -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1, num_threads=1)
    env.reset(flown.episode.seed)
    for action, expected in zip(flown.episode.executed_actions, flown.flags, strict=True):
        np.testing.assert_array_equal(env.step(action[None]).info["subtasks"][0], expected)
    env.close()
    assert flown.flags[-1].all()


def test_the_page_needs_nothing_else_and_tells_the_outcome(page: Path, flown: Flown) -> None:
    html = page.read_text()
    assert needs_nothing_else(html)
    assert flown.episode.spec.instruction in html
    assert "No film here." in html
    assert ">success</dd>" in html
    assert html.count('class="lane"') == len(flown.episode.spec.subtasks)
    assert {"video"} & set(Outline(html).tags) == set()


def test_every_line_spans_the_flight(flown: Flown) -> None:
    shown = trace_plots(flown.episode)
    assert {"End effector", "Distances", "Arm", "Thrust commanded", "Reward"} <= {one.title for one in shown}
    for one in shown:
        low, high = one.range
        for line in one.series:
            known = line.values[np.isfinite(line.values)]
            assert line.values.shape == (len(flown.episode) + 1,)
            assert len(known) >= len(flown.episode)
            assert low <= known.min() <= known.max() <= high


def test_a_robot_that_is_not_ours_and_has_no_arm_is_shown_too(flown: Flown, tmp_path: Path) -> None:
    foreign = replace(
        flown.episode,
        spec=replace(flown.episode.spec, robot="somebody_else"),
        obs={name: value for name, value in flown.episode.obs.items() if not name.startswith(("ee", "joint", "grip"))},
    )
    titles = [one.title for one in trace_plots(foreign)]
    assert "Vehicle" in titles
    assert not {"Arm", "Gripper", "Thrust commanded"} & set(titles)
    assert needs_nothing_else(write_player(tmp_path / "f.html", foreign).read_text())


@pytest.mark.render
def test_a_recording_is_filmed_in_real_time_to_its_end(
    flown: Flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video, "VIEW_SIZE", (60, 80))
    short: Episode = replace(flown.episode, **cut(flown.episode, 21))
    path = video.film_recording(short, tmp_path / "film.mp4", flags=flown.flags[:21])
    with av.open(str(path)) as container:
        frames = sum(1 for _ in container.decode(video=0))
        assert container.streams.video[0].average_rate == video.FPS
    assert frames == 12 + round(video.HOLD_S * video.FPS)


def cut(episode: Episode, steps: int) -> dict[str, Any]:
    one_more = {"states": episode.states[: steps + 1], "sim_time": episode.sim_time[: steps + 1]}
    return one_more | {name: getattr(episode, name)[:steps] for name in ("actions", "phase", "terminated")}


class Screen:
    """Stands in for MuJoCo's window: it is closed after some moments, and notes what it was shown."""

    def __init__(self, moments: int) -> None:
        self.left, self.shown, self.cam = moments, [], mujoco.MjvCamera()

    def launch(self, model: mujoco.MjModel, data: mujoco.MjData, **_: Any) -> Any:
        self.data = data
        return self

    def __enter__(self) -> Screen:
        return self

    def __exit__(self, *_: object) -> None: ...

    def lock(self) -> Any:
        return nullcontext()

    def is_running(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def sync(self) -> None:
        self.shown.append(self.data.qpos.copy())


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[Screen]:
    import mujoco.viewer

    shown = Screen(moments=150)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", shown.launch)
    monkeypatch.setattr(window, "require_window", lambda: None)
    monkeypatch.setattr(window, "time", SimpleNamespace(perf_counter=lambda: 0.0, sleep=lambda _: None))
    return shown


def test_a_window_shows_the_recorded_states_over_and_over(flown: Flown, screen: Screen) -> None:
    window.show_recording(flown.episode)
    length = len(flown.episode) + 1
    expected = flown.episode.obs["base_pos"][np.arange(150) % length]
    np.testing.assert_allclose(np.array(screen.shown)[:, :3], expected, atol=1e-12)


def test_a_window_shows_one_flight_then_the_next(flown: Flown, screen: Screen) -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1, num_threads=1)
    window.show_live(env, aerial_il.expert("ua_quad_arm4", "reach"), flown.episode.seed)
    length = len(flown.episode)
    recorded, shown = flown.episode.obs["base_pos"], np.array(screen.shown)[:, :3]
    np.testing.assert_array_equal(shown[:length], recorded[1:])
    assert int(env.simulation.seeds[0]) == flown.episode.seed + 1
    env.close()


def test_a_window_that_cannot_open_says_what_to_do(flown: Flown, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in window.SCREENS:
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(window.WindowError, match=r"No window can be opened here .*viewer=page"):
        window.show_recording(flown.episode)


@pytest.mark.browser
@needs_browser
def test_the_traces_follow_the_clock(page: Path, flown: Flown) -> None:
    middle = 0.5 * len(flown.episode) * flown.episode.spec.control_dt_s
    dom = dom_after(page, f"jump({middle})")
    assert f'id="clock">{middle:.2f} of' in dom
    moved = {float(x) for x in re.findall(r'class="playhead"[^>]*translate\(([\d.]+)', dom)}
    assert len(moved) == 1
    assert moved.pop() == pytest.approx(0.5 * 264.0, abs=0.5)
    shown = re.search(r"Speed of the base.*?<output>([\d.]+)</output>", dom, re.DOTALL)
    assert shown is not None
    speed = np.sqrt((flown.episode.obs["base_vel"] ** 2).sum(axis=1))[len(flown.episode) // 2]
    assert float(shown[1]) == pytest.approx(speed, abs=0.03)
