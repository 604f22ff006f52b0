"""A scene out of a recording: whatever shows it passes one door, where only what our own scenes have is let in."""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core import scene_gate
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.mjcf import check_scene
from aerial_il.core.scene_gate import admit, compiled
from aerial_il.core.xml_tree import parse_xml
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.formats import robomimic
from aerial_il.data.recording.writer import write_episode
from aerial_il.suite.scenario import Scenario
from tests.safety.bounds import MAX_BYTES, MAX_CPU_S, peak

ASSETS, WORLD, END = "<asset>", "<worldbody>", "</mujoco>"
BOX = '<geom type="box" size=".1 .1 .1"/>'
TEXTURE = '<texture name="t{}" type="2d" builtin="flat" width="{}" height="{}"/>'
DISC = "<geom type='mesh' mesh='m'/>"
HOSTILE = {  # name -> what is put behind which part of a scene, and what is answered
    "mesh of this machine": (ASSETS, '<mesh name="m" file="{outside}"/>', "<mesh file="),
    "texture of this machine": (ASSETS, '<texture name="t" type="2d" file="{outside}"/>', "<texture file="),
    "texture that is a pipe": (ASSETS, '<texture name="t" type="2d" file="{pipe}"/>', "<texture file="),
    "sides of a cube": (ASSETS, '<texture name="t" type="cube" fileright="{outside}"/>', "<texture fileright="),
    "height field": (ASSETS, '<hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/>', "<hfield>"),
    "include": (WORLD, '<include file="{outside}"/>', "<include>"),
    "plugin": ("<mujoco", "/><extension><plugin plugin='x'/></extension", "XML|<extension>"),
    "replicate": (WORLD, f'<replicate count="100000000">{BOX}</replicate>', "<replicate>"),
    "replicate of a namespace": (WORLD, f'<replicate xmlns="z" count="100000000">{BOX}</replicate>', "<replicate>"),
    "replicate of a prefix": (WORLD, f'<z:replicate xmlns:z="z" count="9">{BOX}</z:replicate>', "<z:replicate>"),
    "composite": (WORLD, '<body><composite type="cable" count="90000 1 1"/></body>', "<composite>"),
    "flexible grid": (WORLD, '<body><flexcomp type="grid" count="900 900 9"/></body>', "<flexcomp>"),
    "one texture": (ASSETS, TEXTURE.format(0, 30000, 30000), "width of <texture> is 30000"),
    "hexadecimal texture": (ASSETS, TEXTURE.format(0, "0x7530", "0x7530"), "is '0x7530'"),
    "many textures": (ASSETS, "".join(TEXTURE.format(i, 4000, 4000) for i in range(200)), "pixels together"),
    "cube of six sides": (ASSETS, '<texture name="t" type="cube" builtin="flat" width="4096"/>', "pixels together"),
    "mesh made by MuJoCo": (ASSETS, '<mesh name="m" builtin="sphere" params="14"/>', "<mesh builtin="),
    "actuator's memory": (END, '<actuator><general actdim="1000000000"/></actuator></mujoco>', "<general actdim="),
    "length range": (END, "<compiler><lengthrange mode='all'/></compiler></mujoco>", "<lengthrange>"),
    "muscle": (END, "<actuator><general dyntype='muscle'/></actuator></mujoco>", "'muscle'"),
    "user data": (END, "<size nuserdata='2000000000'/></mujoco>", "nuserdata of <size>"),
    "user data of geoms": (END, "<size nuser_geom='2000000000'/></mujoco>", "<size nuser_geom="),
    "arena": (END, "<size memory='900G'/></mujoco>", "of memory"),
    "slices of a ball": (END, "<visual><quality numslices='1000000'/></visual></mujoco>", "numslices"),
    "mass beyond numbers": (WORLD, '<geom type="box" size=".1 .1 .1" mass="1e308"/>', "mass of <geom>"),
    "no number": (WORLD, '<geom type="box" size="nan .1 .1"/>', "no finite number"),
    "numbers of a custom field": (END, "<custom><numeric name='n' size='100000000'/></custom></mujoco>", "<custom>"),
    "entities": ("", '<!DOCTYPE m [<!ENTITY a "aaaa">]>', "document type"),
    "too many bodies": (WORLD, BOX * 5000, "more than 4000"),
    "too deep": (WORLD, "<body>" * 200 + "</body>" * 200, "within one another"),
    "name without end": (WORLD, f'<site name="{"n" * 1000}"/>', "characters"),
    "no such thing": (WORLD, '<geom type="mesh" mesh="absent"/>', "MuJoCo cannot compile it"),
}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    out = tmp_path_factory.mktemp("flown") / "hover"
    aerial_il.collect(robot="quad", task="hover", episodes=1, out=out, progress=False)
    return open_dataset(out)[0]


def hostile(xml: str, name: str, folder: Path) -> str:
    (outside := folder / "outside.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\n")
    if not (pipe := folder / "pipe.png").exists():
        os.mkfifo(pipe)
    behind, added, _ = HOSTILE[name]
    added = added.replace("{outside}", str(outside)).replace("{pipe}", str(pipe))
    at = xml.index(behind)
    return xml[:at] + added + xml[at:] if behind in ("", END) else xml.replace(behind, behind + added, 1)


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_scene(name: str, flight: Episode, tmp_path: Path) -> None:
    xml = hostile(flight.model_xml, name, tmp_path)
    if name not in ("no such thing", "entities"):
        xml = xml.replace(f"{END}</mujoco>", END)
    before, started = peak(reset=True), time.process_time()
    with pytest.raises(InvalidValueError, match=HOSTILE[name][2]):
        admit(xml)
    assert time.process_time() - started < MAX_CPU_S
    assert peak() - before < MAX_BYTES


@pytest.mark.parametrize("cell", sorted({"/".join(cell) for cell in aerial_il.list_cells()}))
def test_every_scene_of_ours_is_let_in(cell: str) -> None:
    for tier in ("calm", "hard"):
        check_scene(parse_xml(Scenario(*cell.split("/"), tier).xml))


def test_what_is_let_in_is_the_scene(flight: Episode) -> None:
    ours = mujoco.MjModel.from_xml_string(flight.model_xml)
    assert (compiled(flight.model_xml).body_mass == ours.body_mass).all()


def test_what_only_compiling_shows_is_bounded() -> None:
    """A pile of boxes passes the list: a few bytes each, and a matrix of all against all."""
    box = '<body pos="0 0 {}"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    pile = f"<mujoco><worldbody>{''.join(box.format(i * 1e-4) for i in range(1900))}</worldbody></mujoco>"
    before, started = peak(reset=True), time.process_time()
    with pytest.raises(InvalidValueError, match="memory"):
        admit(pile)
    assert time.process_time() - started < MAX_CPU_S
    assert peak() - before < MAX_BYTES


def test_a_scene_that_kills_its_compiler_is_refused() -> None:
    compiler = scene_gate._compiler(os.getpid())
    compiler._process.kill()
    compiler._process.wait()
    tiny = "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    with pytest.raises(InvalidValueError, match="takes more than"):
        admit(tiny)
    admit(tiny)


SHOWN: dict[tuple[str, str], Callable[[Path], list[str]]] = {
    ("inspect", "mcap"): lambda path: ["inspect", f"path={path}", "save=seen.rrd"],
    ("inspect", "hdf5"): lambda path: ["inspect", f"path={path}", "save=seen.rrd"],
    ("convert to rerun", "mcap"): lambda path: ["convert", f"path={path}", "format=rrd", "out=seen.rrd"],
    ("convert to rerun", "hdf5"): lambda path: ["convert", f"path={path}", "format=rrd", "out=seen.rrd"],
    ("convert for ROS", "mcap"): lambda path: ["convert", f"path={path}", "format=mcap", "out=seen.mcap"],
    ("convert for ROS", "hdf5"): lambda path: ["convert", f"path={path}", "format=mcap", "out=seen.mcap"],
    ("view", "mcap"): lambda path: ["view", f"recording={path}", "viewer=page", "out=seen.html", "progress=false"],
}


@pytest.mark.parametrize(("command", "form"), SHOWN)
def test_no_command_shows_what_lies_outside(
    command: str, form: str, flight: Episode, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    scene = hostile(flight.model_xml, "mesh of this machine", tmp_path).replace(WORLD, WORLD + DISC, 1)
    episode = replace(flight, model_xml=scene)
    assert mujoco.MjModel.from_xml_string(scene).nmesh, "a careless reader would read it"
    path = tmp_path / f"{episode.uid}.{form}"
    write_episode(episode, path) if form == "mcap" else robomimic.write([episode], path)
    status = main(SHOWN[command, form](path))
    said = "".join(capfd.readouterr())
    assert "<mesh file=...>" in said, (status, said)
    assert status in (0, 1, 2)
