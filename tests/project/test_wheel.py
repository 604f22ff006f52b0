"""The package as others get it: built, installed into an empty environment, and used elsewhere."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
UV = shutil.which("uv", path=f"{ROOT / '.tools/bin'}:{Path(sys.prefix).resolve().parent / '.tools/bin'}:{os.defpath}")
SMALL = ["task=reach", "episodes=4", "evaluation_episodes=2", "algorithm.steps=20", "policy.hidden=[8]"]
PLUGIN = """
from lerobot.utils.import_utils import register_third_party_plugins
register_third_party_plugins()
from lerobot.envs.configs import EnvConfig
assert "aerial_il" in EnvConfig.get_known_choices()
"""
CONFIGURATION = """
import aerial_il
from pathlib import Path
from aerial_il.core import presets
package = Path(aerial_il.__file__).parent
assert "site-packages" in package.parts and presets.folder() == package / "conf", presets.folder()
assert (package / "py.typed").is_file()
"""


def files(folder: Path) -> set[str]:
    """Return the files of a package, caches of compiled code left out."""
    result = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {str(path.relative_to(folder)) for path in result}


def ran(*words: object, cwd: Path) -> str:
    outside = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([str(w) for w in words], cwd=cwd, env=outside, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(UV is None, reason="uv is not here")
def test_an_installed_wheel_does_all_that_a_checkout_does(tmp_path: Path) -> None:
    home, bin = tmp_path / "home", tmp_path / "env" / "bin"
    home.mkdir()
    ran(UV, "build", "--wheel", "--python", sys.executable, "--out-dir", tmp_path / "dist", ROOT, cwd=home)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    pins = "\n".join(line.removesuffix(" \\") for line in (ROOT / "requirements.lock").read_text().splitlines()
                     if line[:1].isalnum())  # fmt: skip
    (tmp_path / "pins.txt").write_text(pins)
    ran(UV, "venv", "--python", sys.executable, tmp_path / "env", cwd=home)
    install = [UV, "pip", "install", "--python", bin / "python"]
    ran(*install, "--constraints", tmp_path / "pins.txt", wheel, ROOT / "plugins/lerobot_env_aerial_il", cwd=home)
    (package,) = (tmp_path / "env/lib").glob("python3*/site-packages/aerial_il")
    shipped = files(package)
    assert not [file for file in files(package.parent) if file.startswith("experiments/")], "studies do not ship"

    assert "aerial-il COMMAND" in ran(bin / "aerial-il", "--help", cwd=home)
    assert "fa_hexa_arm4" in ran(bin / "aerial-il", "list", cwd=home)
    ran(bin / "python", "-c", CONFIGURATION, cwd=home)
    ran(bin / "python", "-c", PLUGIN, cwd=home)
    told = subprocess.run([bin / "aerial-il", "bench", "wind"], cwd=home, capture_output=True, text=True, check=False)
    assert (told.returncode, "Studies are run from a checkout" in told.stderr) == (2, True)
    assert "success" in ran(bin / "aerial-il", "demo", *SMALL, "progress=false", cwd=home)
    assert (home / "runs/demo/evaluation/report.html").is_file()
    assert files(package) == shipped, "user data goes to the working directory"


def test_the_image_installs_what_setup_would() -> None:
    recipe, setup = (ROOT / "Dockerfile").read_text(), (ROOT / "setup" / "environment.sh").read_text()
    (drawing,) = [line for line in setup.splitlines() if line.strip().startswith('packages="')]
    for package in [*drawing.split('"')[1].split(), "python3", "python3-venv", "make"]:
        assert package in recipe.split(), package
    assert 'CMD ["make", "demo"]' in recipe
    assert "RUN make setup" in recipe
    copied = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split(
        "\n"
    )
    left_out = [line for line in (ROOT / ".dockerignore").read_text().split() if "*" not in line]
    assert not [name for name in copied if any(name.startswith(f"{folder}/") for folder in left_out)]
