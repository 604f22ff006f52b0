"""One dataset recorded by several jobs: the same bytes however many there are, and whichever of them is killed."""

import signal
import subprocess
import time
from hashlib import sha256
from pathlib import Path

import pytest

from aerial_il.cli.commands import find
from aerial_il.cli.compose import compose
from aerial_il.cli.launchers import processes
from aerial_il.cli.main import main
from aerial_il.cli.sweeps import job as jobs_of
from aerial_il.cli.sweeps.job import Job
from aerial_il.workflows import collect

pytestmark = pytest.mark.usefixtures("no_commit")
PARTS = ["episodes=10", "seed=3", "num_envs=2", "progress=false"]
FLOWN = {
    "collect": ["collect", "robot=quad", "task=hover", *PARTS],
    "generate": ["generate", *PARTS],
}


def contents(folder: Path) -> dict[str, str]:
    """Return all that a dataset holds but its diary, by its digest."""
    files = [file for kind in ("demos", "failures", "models") for file in (folder / kind).glob("*")]
    assert len(files) == 11, "ten episodes and the scene"
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in [*files, folder / "dataset.yaml"]}


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One flight to generate from."""
    folder = tmp_path_factory.mktemp("shown") / "one"
    words = ["task=press_button", "robot=fa_hexa_arm4", "episodes=1", "expert.noise=0", "progress=false"]
    assert main(["collect", *words, f"out={folder}"]) == 0
    return folder


@pytest.mark.parametrize(
    ("command", "shard", "victims", "jobs"),
    [
        ("collect", 6, {"seed=3"}, 2),
        pytest.param("collect", 4, {"seed=3", "seed=7"}, 3, marks=pytest.mark.slow),
        pytest.param("generate", 4, {"seed=3", "seed=7"}, 3, marks=pytest.mark.slow),
    ],
)
def test_the_dataset_is_the_same_whoever_records_or_is_killed(
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    shard: int,
    victims: set[str],
    jobs: int,
) -> None:
    typed = [*FLOWN[command]]
    if command == "generate":
        typed.append(f"dataset={request.getfixturevalue('shown')}")
    assert main([*typed, f"out={tmp_path}/whole"]) == 0
    killed = set[str]()

    def start(job: Job, **limits: int) -> subprocess.Popen[bytes]:
        process = jobs_of.start(job, **limits)
        if job.name in victims - killed:
            while process.poll() is None and not list((tmp_path / "ds" / "demos").glob("*.mcap*")):
                time.sleep(0.002)
            process.kill()
            assert process.wait() == -signal.SIGKILL, "it was done before"
            killed.add(job.name)
        return process

    monkeypatch.setattr(processes, "start", start)
    assert main([*typed, f"out={tmp_path}/ds", f"shard={shard}", "launcher=processes", "launcher.jobs=2"]) == 0
    assert killed == victims
    assert contents(tmp_path / "ds") == contents(tmp_path / "whole")
    assert len(list((tmp_path / "ds" / ".shards").iterdir())) == jobs


def test_the_shards_hold_each_seed_once() -> None:
    for episodes, shard in ((1, 1), (7, 3), (9, 3), (1000, 1000), (5, 100)):
        config = compose(find("collect"), ["out=o", f"episodes={episodes}", f"shard={shard}", "seed=11"])
        seeds: list[int] = []
        for words, _ in collect.shards(config):
            said = dict(word.split("=") for word in words)
            seeds += range(int(said["seed"]), int(said["seed"]) + int(said["episodes"]))
        assert seeds == list(range(11, 11 + episodes))
