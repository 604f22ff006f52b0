"""``aerial-il bench`` as a user types it."""

from __future__ import annotations

import copy
import json
import shlex
import subprocess
import sys
from pathlib import Path

from aerial_il.cli import commands
from aerial_il.cli.commands.project import bench
from aerial_il.cli.configuration import compose, groups

SCRIPT = Path(sys.executable).with_name("aerial-il")
SETTINGS = (
    "bench.robots=[fa_hexa_arm4]",
    "bench.tiers=[calm]",
    "bench.seeds=1",
    "bench.settle_s=0.1",
    "bench.duration_s=0.1",
)


def test_one_json_object_on_stdout_and_a_study_with_the_command_that_makes_it(tmp_path: Path) -> None:
    words = [SCRIPT, "bench", "tracking", *SETTINGS, "save=true", "--json"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["benchmark"] == "tracking"
    study = json.loads((tmp_path / "experiments" / "tracking" / "results.json").read_text())
    assert set(shlex.split(study["command"])) == {"aerial-il", "bench", "tracking", *SETTINGS, "save=true"}
    assert "tracking/README.md" in (tmp_path / "experiments" / "benchmarks.md").read_text()
    assert (tmp_path / "runs" / "benchmarks" / "tracking" / "report.json").exists()


def test_the_command_names_only_what_differs_from_the_file() -> None:
    settings = groups.read_option("bench", "learning_curve")
    assert bench.rerun("learning_curve", settings) == "aerial-il bench learning_curve save=true"
    settings["policy"] = {**settings["policy"], "chunk": 5, "hidden": [8, 8]}
    assert shlex.split(bench.rerun("learning_curve", settings))[3:] == [
        "bench.policy.chunk=5", "bench.policy.hidden=[8,8]", "save=true"
    ]  # fmt: skip


def test_the_command_names_what_was_left_out_and_quotes_what_a_shell_would_take_apart() -> None:
    adroit, dagger = (copy.deepcopy(groups.read_option("bench", name)) for name in ("adroit", "dagger"))
    del adroit["policies"]["act"]
    del adroit["interactive"]["thrifty"]["gate"]
    dagger["arms"] = ["bc, as many episodes", "dagger"]
    found = bench.rerun("adroit", adroit), bench.rerun("dagger", dagger)
    assert shlex.split(found[0])[3:-1] == ["~bench.policies.act", "~bench.interactive.thrifty.gate"]
    assert shlex.split(found[1])[3:-1] == ["bench.arms=['bc, as many episodes',dagger]"]
    command = compose.compose(commands.find("bench"), ["dagger", *shlex.split(found[1])[3:]])
    assert command.bench["arms"] == dagger["arms"]


def test_the_command_adds_what_the_file_has_no_place_for() -> None:
    settings = copy.deepcopy(groups.read_option("bench", "from_prior"))
    settings["fewer"] = {**settings.get("fewer", {}), "bc_ppo": 2}
    said = shlex.split(bench.rerun("from_prior", settings))[3:-1]
    assert said == ["+bench.fewer.bc_ppo=2"]
    assert compose.compose(commands.find("bench"), ["from_prior", *said]).bench["fewer"]["bc_ppo"] == 2
