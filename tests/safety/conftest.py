"""A dataset, its derived forms and a run, made once; attacks are copies of them with something changed."""

import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import minari, robomimic
from tests.safety.hostile import Sound

ENV = "env=gymnasium:CartPole-v1"
QUIET = "progress=false"
CLONE = ["policy.hidden=[8]", "policy.chunk=1", "policy.ensemble=null", "algorithm.steps=2",
         "algorithm.validate_every=0", "algorithm.cadence.log_every=1"]  # fmt: skip


@pytest.fixture(scope="session")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Sound:
    home = tmp_path_factory.mktemp("sound")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        flown = ["success=survived", "max_steps=5", "episodes=3", "threads=1", QUIET]
        assert main(["collect", ENV, "policy=random", *flown, "out=demos"]) == 0
        assert main(["convert", "demos", "out=lerobot", QUIET]) == 0
        assert main(["train", "dataset=demos", "run=run", *CLONE, QUIET]) == 0
        judged = ["episodes=2", "videos=0", "threads=1", QUIET]
        assert main(["evaluate", "policy=run", ENV, "out=judged", "success=survived", "max_steps=5", *judged]) == 0
    episodes = list(open_dataset(home / "demos"))
    robomimic.write(episodes, home / "demos.hdf5")
    minari.write(episodes, home / "minari-v0")
    victim = home / "victim"
    (victim / "numbers" / "00000001").mkdir(parents=True)
    (victim / "precious.txt").write_text("the precious words of somebody else\n")
    for number in range(2, 9):
        (victim / "numbers" / f"{number:08d}").mkdir()
    (home / "bait.py").write_text(f"from pathlib import Path\nPath({str(home / 'canary')!r}).touch()\n")
    forms = home / "demos.hdf5", home / "lerobot", home / "minari-v0"
    return Sound(home / "demos", *forms, home / "run", home / "canary", victim)
