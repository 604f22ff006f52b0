"""A disk that takes no more: the file is named, what was finished is whole, and the same command goes on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from aerial_il.cli.main import main

FLOWN = ["evaluate", "policy=hover", "robot=quad", "task=hover", "episodes=3", "videos=0", "progress=false"]
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
from aerial_il.cli.main import main
sys.exit(main(sys.argv[2:]))
"""


def run_with(most_bytes: int, words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command that may write no file of more bytes, which the system refuses as on a full disk."""
    command = [sys.executable, "-c", LIMITED, str(most_bytes), *words]
    return subprocess.run(command, cwd=folder, env=dict(os.environ), capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole evaluation and a dataset; what flies is compiled then, and its cache asks for no room."""
    folder = tmp_path_factory.mktemp("full")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main([*FLOWN, "out=whole"]) == 0
        assert main(["collect", "robot=quad", "task=hover", "episodes=1", "out=demos", "progress=false"]) == 0
    return folder


@pytest.mark.parametrize(
    ("most_bytes", "words", "file"),
    [
        (512, [*FLOWN, "out=part"], "part/flights/evaluated.json"),
        (6000, [*FLOWN, "out=part"], "part/evaluation.json"),
        (6000, ["report", "whole", "out=page.html"], "page.html"),
        (9000, ["convert", "demos", "out=x.rrd", "format=rrd", "progress=false"], "x.rrd"),
    ],
)
def test_a_full_disk_names_the_file(home: Path, most_bytes: int, words: list[str], file: str) -> None:
    done = run_with(most_bytes, words, home)
    assert done.returncode in (1, 2)
    answer = next(line for line in done.stderr.splitlines() if line.startswith("aerial-il: "))
    assert answer.startswith(f"aerial-il: {file}: ")
    assert "run the same command again" in answer
    assert "Traceback" not in done.stderr
    assert not (home / file).exists()
    assert not [path for path in home.rglob(".*") if path.suffix in (".tmp", ".part")]


def test_the_same_command_goes_on_when_there_is_room(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)
    assert run_with(6000, [*FLOWN, "out=again"], home).returncode == 1
    assert sorted(path.name for path in Path("again/flights").glob("*.npz"))
    assert main([*FLOWN, "out=again"]) == 0
    whole, again = (Path(name, "evaluation.json").read_text().split("provenance")[0] for name in ("whole", "again"))
    assert whole == again
