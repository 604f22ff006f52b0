"""Nothing of the user's is destroyed: every command that writes is sent to places that are somebody else's."""

from collections.abc import Callable
from pathlib import Path

import pytest

from aerial_il.cli import commands
from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.places import claim_file, claim_folder
from tests.safety.conftest import CLONE, ENV, QUIET
from tests.safety.hostile import Sound, trace

FLOWN = ["success=survived", "max_steps=5", "episodes=1", "threads=1", QUIET]
BRIEF = ["films=0", QUIET]
Words = Callable[[Sound, Path], list[str]]
FILES: dict[str, tuple[str, Words]] = {  # what is written -> its ending, and what is typed
    "browse": (".html", lambda s, out: ["browse", f"dataset={s.dataset}", f"out={out}", QUIET]),
    "card": (".html", lambda s, out: ["card", f"path={s.dataset}", f"out={out}", "films=0", QUIET]),
    "card for a hub": (".md", lambda s, out: ["card", f"path={s.dataset}", "out=a.html", f"readme={out}", *BRIEF]),
    "convert to robomimic": (".hdf5", lambda s, out: ["convert", f"path={s.dataset}", f"out={out}", QUIET]),
    "convert to d4rl": (".hdf5", lambda s, out: ["convert", f"path={s.dataset}", "format=d4rl", f"out={out}", QUIET]),
    "convert to rerun": (".rrd", lambda s, out: ["convert", f"path={s.dataset}", f"out={out}", QUIET]),
    "convert for ROS": (".mcap", lambda s, out: ["convert", f"path={s.recording}", "format=mcap", f"out={out}", QUIET]),
    "leaderboard": (".html", lambda s, out: ["leaderboard", f"result={s.run.parent / 'judged'}", f"out={out}"]),
    "report of a run": (".html", lambda s, out: ["report", f"result={s.run}", f"out={out}"]),
    "report of flights": (".html", lambda s, out: ["report", f"result={s.run.parent / 'judged'}", f"out={out}"]),
    "report of a dataset": (".html", lambda s, out: ["report", f"result={s.dataset}", f"out={out}"]),
    "view of a recording": (".html", lambda s, out: ["view", f"recording={s.recording}", f"out={out}", QUIET]),
    "view of a flight": (".html", lambda s, out: ["view", ENV, f"policy={s.run}", f"out={out}", QUIET]),
    "prefer": (".jsonl", lambda s, out: ["prefer", f"dataset={s.dataset}", "length=2", "pairs=1", f"out={out}", QUIET]),
    "inspect": (".rrd", lambda s, out: ["inspect", f"path={s.recording}", f"save={out}"]),
    "picture": (".png", lambda s, out: ["inspect", f"path={s.recording}", "save=a.rrd", f"screenshot={out}"]),
    "film": (".webp", lambda s, out: ["film", "flights=[quad/hover]", f"out={out}", QUIET]),
}
FOLDERS: dict[str, Words] = {
    "convert to LeRobot": lambda s, out: ["convert", f"path={s.dataset}", "format=lerobot", f"out={out}", QUIET],
    "publish": lambda s, out: ["publish", f"dataset={s.dataset}", f"out={out}", "license=mit", *BRIEF],
    "convert to Minari": lambda s, out: ["convert", f"path={s.dataset}", "format=minari", f"out={out}", QUIET],
    "convert for ROS": lambda s, out: ["convert", f"path={s.dataset}", "format=mcap", f"out={out}", QUIET],
    "collect": lambda s, out: ["collect", ENV, "policy=random", f"out={out}", *FLOWN],
    "fly": lambda s, out: ["fly", "policy=hover", "robot=quad", "task=hover", f"out={out}", "episodes=1", QUIET],
    "generate": lambda s, out: ["generate", f"dataset={s.dataset}", f"out={out}", "episodes=1", QUIET],
    "merge": lambda s, out: ["merge", str(s.dataset), str(s.dataset), f"out={out}", QUIET],
    "split": lambda s, out: ["split", f"dataset={s.dataset}", f"out={out}", QUIET],
    "filter": lambda s, out: ["filter", f"dataset={s.dataset}", "where=steps > 0", f"out={out}", QUIET],
    "evaluate": lambda s, out: ["evaluate", f"policy={s.run}", ENV, f"out={out}", "videos=0", *FLOWN],
    "train": lambda s, out: ["train", f"dataset={s.dataset}", f"run={out}", *CLONE, "threads=1", QUIET],
    "pages": lambda s, out: ["docs", f"out={out}", "site=null"],
    "site": lambda s, out: ["docs", "out=null", f"site={out}"],
    "teleop": lambda s, out: ["teleop", "robot=quad", "task=hover", f"out={out}", "open=false", "port=0"],
    "demo": lambda s, out: ["demo", f"out={out}", QUIET],
}
OWN_WAYS = {"bench", "export", "new", "reward", "runs"}  # export in its own test; new refuses what is there; the others
# write beside what they read


def test_every_command_that_writes_is_tried() -> None:
    typed = (
        {words(None, Path("x"))[0] for words in FOLDERS.values()} if False else {name.split()[0] for name in FOLDERS}
    )
    typed |= {name.split()[0] for name in FILES} - {"picture"} | {"docs"} - {"pages", "site"}
    writing = {name for name in commands.names() if commands.find(name).output}
    assert writing <= typed | OWN_WAYS, writing - typed - OWN_WAYS


def precious(folder: Path) -> Path:
    """Make a folder of somebody else's, with names that our own folders have too."""
    for name in ("notes.md", "report.html", "config.yaml", "meta/info.json", "data/a.csv", "robots/quad.md"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(
            f"precious words about aerial_il in {name}\n" if name == "notes.md" else "precious\n"
        )
    return folder


def refused(typed: list[str], kept: Path, capfd: pytest.CaptureFixture[str]) -> None:
    before = trace(kept)
    status = main(typed)
    said = "".join(capfd.readouterr())
    assert status == 2, said
    assert trace(kept) == before
    assert "Traceback" not in said
    assert str(kept) in said


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_somebody_else_is_left_alone(
    name: str, sound: Sound, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    ending, words = FILES[name]
    (theirs := tmp_path / "theirs").mkdir()
    file, link = theirs / f"mine{ending}", theirs / f"link{ending}"
    file.write_text("precious words\n")
    link.symlink_to(file)
    (theirs / f"folder{ending}").mkdir()
    for out in (file, link, theirs / f"folder{ending}", file / f"below{ending}"):
        refused(words(sound, out), theirs, capfd)


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_of_somebody_else_is_left_alone(
    name: str, sound: Sound, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    theirs, words = precious(tmp_path / "theirs"), FOLDERS[name]
    (link := tmp_path / "theirs too").symlink_to(theirs)
    for out in (theirs, theirs / "notes.md"):
        refused(words(sound, out), theirs, capfd)
    before = trace(theirs)
    assert main(words(sound, link)) == 2
    assert trace(theirs) == before
    if name.startswith("convert"):
        refused(words(sound, sound.dataset.parent), sound.dataset.parent, capfd)  # a parent of what is read


def test_what_was_written_here_is_replaced_and_nothing_beside_it(
    sound: Sound, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("convert to robomimic", "convert to d4rl", "convert to rerun", "report of a run"):
        out = tmp_path / f"own{len(name)}{FILES[name][0]}"
        for _ in range(2):
            assert main(FILES[name][1](sound, out)) == 0, capfd.readouterr()
    for name in ("publish", "convert to LeRobot", "convert to Minari"):
        out = tmp_path / f"{name.split()[-1]}-v0"
        for _ in range(2):
            assert main(FOLDERS[name](sound, out)) == 0, capfd.readouterr()
        (out / "my notes.txt").write_text("precious\n")
        refused(FOLDERS[name](sound, out), out, capfd)


def test_new_and_empty_places_are_free(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty.html").touch()
    for name in ("empty.html", "new.html", "new/new.html"):
        assert claim_file(tmp_path / name) == tmp_path / name
    for name in ("empty", "new", "new/new"):
        assert claim_folder(tmp_path / name, ()) == tmp_path / name
    (tmp_path / "page.html").write_text("<p>My own page about aerial_il</p>")
    with pytest.raises(InvalidValueError, match="not written by aerial_il"):
        claim_file(tmp_path / "page.html")
