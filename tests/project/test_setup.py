"""What a new user and a continuous-integration machine rely on before any code of ours runs."""

import os
import re
import subprocess
from pathlib import Path

import pytest

import aerial_il
from aerial_il.core import rendering
from aerial_il.core.errors import AerialError

ROOT = Path(__file__).resolve().parents[2]
LOCK = (ROOT / "requirements.lock").read_text()


def test_the_lock_pins_hashes_and_names_no_address() -> None:
    assert "://" not in LOCK
    for requirement in re.split(r"\n(?=\S)", LOCK.strip()):
        assert re.match(r"[\w.\-]+==\S+", requirement), requirement[:80]
        assert "--hash=sha256:" in requirement, requirement[:80]


def test_the_lock_has_every_direct_dependency() -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    locked = {name.lower().replace("_", "-") for name in re.findall(r"^([\w.\-]+)==", LOCK, flags=re.M)}
    for requirement in wanted:
        name = re.match(r"[\w.\-]+", requirement)
        assert name
        assert name[0].lower().replace("_", "-") in locked


@pytest.mark.parametrize("script", sorted((ROOT / "setup").glob("*.sh")), ids=lambda path: path.name)
def test_a_script_is_valid_posix_shell(script: Path) -> None:
    subprocess.run(["sh", "-n", script], check=True)


@pytest.mark.parametrize(("words", "said"), [((), "bookworm"), (("sid",), "trixie"), (("trixie", "tour"), "notebook")])
def test_an_unknown_path_of_a_newcomer_lists_the_choices(words: tuple[str, ...], said: str) -> None:
    done = subprocess.run([ROOT / "setup" / "newcomer.sh", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr


def test_a_newcomer_gets_the_way_to_the_network_alone(tmp_path: Path) -> None:
    script = (ROOT / "setup" / "newcomer.sh").read_text()
    enter = script[script.index("NETWORK=") : script.index("inside() {")]
    chroot = tmp_path / "chroot"
    chroot.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    chroot.chmod(0o755)
    told = {"https_proxy": "http://proxy:3128", "PIP_INDEX_URL": "http://a/simple http://b", "PYTHONPATH": "/mine"}
    done = subprocess.run(
        ["sh", "-euc", f"{enter}root=/the/root; enter HOME=/home sh -c 'echo one two'"],
        env={"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", **told},
        capture_output=True,
        text=True,
        check=True,
    )
    root, *words = done.stdout.splitlines()
    assert root == "/the/root"
    assert words[:2] == ["/usr/bin/env", "-i"]
    assert sorted(words[2:4]) == ["PIP_INDEX_URL=http://a/simple http://b", "https_proxy=http://proxy:3128"]
    assert words[4:] == ["HOME=/home", "sh", "-c", "echo one two"]


def test_make_help_lists_every_public_target() -> None:
    words = ["make", "--no-print-directory", "help"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    for target in ("setup", "demo", "test", "test-all", "fuzz", "check", "format", "bench", "docs"):
        assert re.search(rf"^  make {target} +\S", done.stdout, flags=re.M)


def test_continuous_integration_runs_the_command_that_people_run() -> None:
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def test_an_interpreter_that_does_not_run_is_named(tmp_path: Path) -> None:
    """In a copy of the checkout's set-up alone, so that nothing is installed."""
    (tmp_path / "setup").mkdir()
    for name in ("requirements.lock", "pyproject.toml", "setup/environment.sh"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    uv = tmp_path / "bin" / "uv"
    uv.parent.mkdir()
    uv.write_text("#!/bin/sh\nexit 0\n")
    uv.chmod(0o755)
    environment = {**os.environ, "PYTHON": "nonsense", "PATH": f"{uv.parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["sh", tmp_path / "setup" / "environment.sh"], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "PYTHON=nonsense is not a Python 3.12 or 3.13 that runs" in done.stderr
    assert not (tmp_path / ".venv").exists()


def test_a_machine_without_pictures_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    assert not rendering.can_render()
    with pytest.raises(AerialError, match=r"cameras=\[wrist\] needs rendering.*apt-get install -y libegl1"):
        rendering.require_rendering("cameras=[wrist]")
    with pytest.raises(AerialError, match="looking at the scene needs rendering"):
        aerial_il.load_batch("quad", "hover", num_envs=1, cameras=("wrist",), image_size=(16, 16))


def test_a_back_end_that_does_not_exist_is_not_chosen() -> None:
    assert "nonsense" in rendering.probe_backend("nonsense")


def test_the_user_s_own_choice_of_back_end_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    assert rendering.choose_backend() == "glfw"
