"""What the page is sent and sends: pictures by the link, in a window of its own, and a person's own keys."""

import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import aerial_il
from aerial_il.core import presets
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.flight import CAMERAS
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.loop import state_of
from aerial_il.teleop.web.controls import Controls
from aerial_il.teleop.web.film import THRIFT, Film, Shot
from aerial_il.teleop.web.link import Link
from aerial_il.teleop.web.window import NoWindowError, open_window, window_program
from tests.patience import HANG_S, until
from tests.teleop.chromium import needs_browser
from tests.teleop.flown import flown
from tests.teleop.hands import schedule, shipped, world

CELLS = dict(reversed(aerial_il.list_cells()))
LEVELS = ("ee_pose", "velocity")


@pytest.mark.render
@pytest.mark.parametrize("robot", CELLS)
@pytest.mark.parametrize("level", LEVELS)
def test_every_robot_is_flown_by_hand_and_seen(tmp_path: Path, robot: str, level: str) -> None:
    env = world(robot, CELLS[robot], action=level)
    cockpit = Cockpit(
        env, shipped("scripted"), Logbook(env, str(tmp_path), operator="ada", first_seed=5000), countdown=3
    )
    shots: list[Shot] = []
    seen = threading.Event()

    def deliver(shot: Shot) -> None:
        shots.append(shot)
        seen.set()

    film = Film(env.model, CAMERAS, (90, 120), deliver)
    film.start()
    try:
        start = state_of(env)
        device = Scripted(schedule((1, 60, ["up+", "forward+", "yaw+"])), cockpit.bindings)
        for _ in range(60):
            cockpit.tick(device.frame())
        film.show(state_of(env), 7)
        assert seen.wait(HANG_S), film.error
    finally:
        film.close()
        cockpit.close()
        env.close()
    assert not np.array_equal(start, state_of(env))
    assert cockpit.status().dead is False
    assert shots[0].input_seq == 7
    for image in shots[0].images:
        (tmp_path / "shot.jpg").write_bytes(image)
        assert np.asarray(Image.open(tmp_path / "shot.jpg")).std() > 5.0, "a picture of something"


@pytest.mark.render
def test_nothing_unseen_is_rendered_and_stills_are_sharp() -> None:
    env, shots, seen = world(), list[Shot](), threading.Event()
    state = state_of(env)

    def deliver(shot: Shot) -> None:
        shots.append(shot)
        seen.set()

    film = Film(env.model, CAMERAS[:1], (90, 120), deliver)
    film.start()
    film.thrift, film.watched = 3, False
    try:
        film.show(state, 1)
        film.watched = True
        for number in (2, 3):
            seen.clear()
            film.show(state, number)
            assert seen.wait(HANG_S), film.error
    finally:
        film.close()
        env.close()
    assert [shot.input_seq for shot in shots] == [2, 3]
    assert len(shots[1].images[0]) > 2 * len(shots[0].images[0])


def test_an_unknown_camera_is_answered_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="chase"):
        Film(world().model, ("chse",), (90, 120), lambda _: None)


def shown(link: Link, now: list[float], count: int, took: float) -> list[int]:
    """Show pictures that take so long; return the thrift after each."""
    result = []
    for number in range(count):
        link.send(number)
        now[0] += took
        link.arrive(number)
        result.append(link.thrift)
    return result


def test_a_narrow_link_gets_the_smallest_pictures_at_once() -> None:
    now = [0.0]
    assert shown(Link(lambda: now[0]), now, 4, 0.45)[-1] == len(THRIFT) - 1
    assert now[0] < 2.0


def test_a_wide_link_keeps_the_best_and_gets_it_back() -> None:
    now = [0.0]
    link = Link(lambda: now[0])
    assert set(shown(link, now, 200, 0.03)) == {0}
    shown(link, now, 10, 0.5)
    assert link.thrift == len(THRIFT) - 1
    assert shown(link, now, 10, 0.03)[-1] == len(THRIFT) - 1, "not at once"
    assert shown(link, now, 700, 0.03)[-1] == 0


def test_what_was_never_sent_means_nothing() -> None:
    link = Link(lambda: 0.0)
    link.arrive(7)
    assert link.thrift == 0


def test_without_a_browser_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(NoWindowError, match="apt install chromium"):
        window_program()


@needs_browser
@pytest.mark.browser
@pytest.mark.render
async def test_the_page_comes_up_in_it(tmp_path: Path) -> None:
    """Without a screen, so the window itself was never seen; that its page connects is."""
    options = ("--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}")
    async with flown(tmp_path / "out") as flight:
        process = open_window(window_program(), flight.server.url, options)
        try:
            await until(lambda: flight.server.visitors.controller is not None)
        finally:
            process.terminate()
            process.wait()


NAMES = ("keyboard", "gamepad", "touch")


def controls(folder: Path) -> Controls:
    return Controls(partial(presets.read, "device"), NAMES, folder)


def keyboard(**changes: tuple[str, ...]) -> dict[str, dict[str, tuple[str, ...]]]:
    """Return the shipped keyboard with changes, as a page sends it."""
    result: dict[str, tuple[str, ...]] = {}
    for control, command in shipped("keyboard").keys.items():
        result[command] = (*result.get(command, ()), control)
    return {"keyboard": result | changes}


def test_a_change_is_used_kept_and_read_again(tmp_path: Path) -> None:
    bindings = controls(tmp_path).change(keyboard(record=("KeyG",)))
    assert bindings.keys_of("record") == ("KeyG", "pad:Start", "touch:record")
    again = controls(tmp_path)
    assert again.own == ("keyboard",)
    assert again.read()["keyboard"]["record"] == ["KeyG"]
    assert again.read()["gamepad"]["forward"] == "-right_y", "axes of other devices stay"
    assert again.reset() == shipped(*NAMES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("wanted", "error", "words"),
    [
        (keyboard(record=("KeyW",)), InvalidValueError, "KeyW is bound twice"),
        (keyboard(fly=("KeyG",)), UnknownNameError, "fly"),
        (keyboard(record=("KeyÜ",)), UnknownNameError, "KeyÜ"),
        ({"touch": {"record": ("touch:record",)}}, InvalidValueError, "touch"),
    ],
)
def test_what_no_mapping_may_say_is_refused_unwritten(tmp_path: Path, wanted, error, words: str) -> None:
    with pytest.raises(error, match=words):
        controls(tmp_path).change(wanted)
    assert not list(tmp_path.iterdir())


def test_without_a_way_to_record_nothing_is_taken(tmp_path: Path) -> None:
    alone = Controls(partial(presets.read, "device"), ("keyboard",), tmp_path)
    with pytest.raises(InvalidValueError, match="record"):
        alone.change(keyboard(record=()))


@pytest.mark.parametrize("content", ["[", "- KeyW\n", "\xff\xfe"])
def test_a_file_that_is_no_mapping_says_how_to_go_on(tmp_path: Path, content: str) -> None:
    (tmp_path / "keyboard.yaml").write_text(content, encoding="latin-1")
    with pytest.raises(InvalidValueError, match="Delete it"):
        controls(tmp_path).read()
