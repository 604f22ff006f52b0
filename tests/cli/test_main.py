"""The console script as a user meets it: quick help, one-paragraph errors, exit statuses."""

import errno
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from aerial_il.cli import commands, main
from aerial_il.cli.compose import compose
from aerial_il.core import composition, schema

SCRIPT = Path(sys.executable).with_name("aerial-il")


def aerial_il(*words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([SCRIPT, *words], capture_output=True, text=True, check=False, cwd=cwd)


HELP = """
import contextlib, io, sys
from aerial_il.cli.main import main
for words in (["--help"], *([name, "--help"] for name in sys.argv[1:])):
    with contextlib.redirect_stdout(io.StringIO()) as said:
        status = main(words)
    heavy = {"torch", "mujoco", "lerobot", "hydra", "matplotlib", "rerun", "numba"} & set(sys.modules)
    heavy |= {"numpy"} & set(sys.modules) if words == ["--help"] else set()
    assert not heavy, f"{words} imports {heavy}"
    assert status == 0 and "key=value" in said.getvalue(), words
"""


def chooses(name: str) -> bool:
    return any(key.takes == "choice" for key in schema.keys(commands.find(name).settings))


def test_help_imports_nothing_heavy() -> None:
    """In one process for all commands but those that choose a policy: what none of them has imported, each has not."""
    light = [name for name in commands.names() if not chooses(name)]
    done = subprocess.run([sys.executable, "-c", HELP, *light], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["trian"], "Did you mean 'train'"),
        (["train", "polcy=mlp"], "Did you mean 'policy'"),
        (["evaluate", "robot=ua_quad_arm5"], "Did you mean 'ua_quad_arm4'"),
        (["train", "seed=abc", "dataset=x", "run=y"], "seed='abc' is not a whole number"),
        (["train", "policy={a"], "policy={a cannot be read: close its brackets and quotes"),
        (["train", "dataset=x", "run=y", "policy._target_=os.system"], "Unknown key 'policy._target_'"),
        (["train", "dataset=x", "run=y", "seed=${nowhere}"], "seed=${nowhere}"),
        (["train", "run=y", "from=runs/a"], "from=runs/a does not exist. To see what runs there are: aerial-il runs"),
        (["train", "dataset=x", "run=y", "flight_tier=gusts"], "flight_tier=gusts is for algorithms that fly while"),
        (["train", "dataset=[a,b]", "run=y"], "the first is dataset=PATH, the rest are dataset.others=[PATH,PATH]"),
        (["train", "run=y", "policy=runs/a"], "with the settings of that run: from=runs/a run=NEW; to go on from its"),
        (["evaluate"], "evaluate needs out=..."),
        (["collect", "out=x", f"seed={2**63}"], "is too large: the maximum is"),
        (["collect", "out=x", "episodes=1000000000"], "episodes=1000000000 is too large"),
        (["collect", "out=x", "num_envs=1000000000"], "num_envs=1000000000 is too large"),
        (["collect", "out=x", "image_size=[10]"], "image_size=[10] is not a list such as [a,b]"),
        (["train", "--info", "dataset=x"], "Unknown option '--info'"),
        (
            ["evaluate", "--config-dir=mine", "policy=x"],
            "settings are said as key=value. See: aerial-il evaluate --help",
        ),
        (["collect", "-cn", "quick"], "--cfg job prints the settings, -m sweeps"),
        (["train", "--multrun"], "Did you mean '--multirun'"),
        (["train", "hydra.verbose=true"], "Unknown key 'hydra.verbose'"),
        (["collect", "out=x", "policy=runs/a"], "policy=runs/a is for env=...: here experts fly"),
        (["collect", "out=x", "max_steps=5"], "is for env=...: here horizon=5 records"),
        (["convert", "x" * 5000, "out=y"], "(5000 characters) cannot be such a path: File name too long"),
    ],
)
def test_a_mistake_is_answered_in_one_paragraph_with_status_2(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main.main(words) == main.BAD_USAGE
    _check_answer(capfd.readouterr().err, said, tmp_path)


def test_a_path_that_a_library_names_in_its_message_is_quoted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def open_it(_: list[str]) -> int:
        raise OSError(errno.ENAMETOOLONG, "Unable to open file (name = 'xxx')")

    monkeypatch.setattr(main, "_dispatch", open_it)
    assert main.main(["info", "xxx"]) == main.BAD_USAGE
    assert "Unable to open file (name = 'xxx')." in capsys.readouterr().err


def test_the_script_answers_a_mistake_so_too(tmp_path: Path) -> None:
    done = aerial_il("train", "seed=abc", "dataset=x", "run=y", cwd=tmp_path)
    assert done.returncode == main.BAD_USAGE
    _check_answer(done.stderr, "seed='abc' is not a whole number", tmp_path)


def _check_answer(answer: str, said: str, folder: Path) -> None:
    assert said in answer
    assert "Traceback" not in answer
    assert len(answer.strip().splitlines()) == 1
    assert not list(folder.iterdir()), "a mistake leaves nothing behind"


LEAVE = """
import atexit, gc
from aerial_il.cli.main import main
assert main(["--version"]) == 0
assert main(["--version"]) == 0
atexit._run_exitfuncs()
found = gc.get_objects()
assert len(found) < 100, len(found)
"""


def test_the_end_does_not_search_what_the_libraries_left() -> None:
    """That took four seconds after Ctrl-C: once on leaving, everything is out of the search."""
    done = subprocess.run([sys.executable, "-c", LEAVE], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_running_leaves_nothing_in_the_working_folder(tmp_path: Path) -> None:
    done = aerial_il("list", "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())


def test_a_failed_job_fails_the_sweep_after_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main.main(["train", "-m", "dataset=nowhere", "run=sweep", "seed=0,1"]) == main.BAD_USAGE
    assert "2 of 2 jobs failed. seed=0, seed=1: nowhere" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("raised", "status", "next_step"),
    [
        (KeyboardInterrupt(), 130, "same command continues"),
        (OSError(errno.ENOSPC, "No space left on device", "demo.mcap"), main.FAILED, "make room and run"),
        (OSError(errno.EROFS, "Read-only file system", "demo.mcap"), main.FAILED, "a place that can be written to"),
        (OSError(errno.EACCES, "Permission denied", "demo.mcap"), main.FAILED, "a place that you may use"),
    ],
)
def test_what_ends_a_command_decides_status_and_next_step(
    raised: BaseException,
    status: int,
    next_step: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(words: list[str]) -> int:
        raise raised

    monkeypatch.setattr(main, "_dispatch", fail)
    assert main.main([]) == status
    assert next_step in capsys.readouterr().err


def test_a_termination_signal_ends_with_143() -> None:
    code = """
import os, signal
from aerial_il.cli import main
main._dispatch = lambda words: os.kill(os.getpid(), signal.SIGTERM) or 0
raise SystemExit(main.main([]))
"""
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == 128 + signal.SIGTERM


def test_the_settings_are_printed_and_lead_back(capsys: pytest.CaptureFixture[str]) -> None:
    command = commands.find("train")
    typed = ["dataset=few", "run=x", "algorithm=hg_dagger", "policy=act_paper", "algorithm.training.steps=7"]
    assert main.main(["train", *typed, "--cfg", "job"]) == main.OK
    printed = yaml.safe_load(capsys.readouterr().out)
    assert printed["algorithm"]["gate"]["name"] == "human"
    assert composition.build(command.settings, printed) == compose(command, typed)


def test_the_help_of_a_choice_has_its_keys(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["train", "algorithm=thrifty_dagger", "policy=diffusion", "--help"]) == main.OK
    said = capsys.readouterr().out
    for key in ("policy.sampler=ddim", "algorithm.training.lr=0.001", "algorithm.gate.ensemble=3", "launcher=serial"):
        assert f"  {key}  " in said
    assert main.main(["train", "algorithm=dager", "--help"]) == main.BAD_USAGE
    assert "Did you mean 'dagger'" in capsys.readouterr().err


def test_a_back_end_that_mujoco_refuses_is_answered(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "bogus")
    assert main.main(["collect", "robot=quad", "task=hover", "out=x"]) == main.BAD_USAGE
    assert "MUJOCO_GL=bogus is no back end. Valid: egl, osmesa, glfw, disabled" in capsys.readouterr().err
