"""The layers between rooms hold, and `import aerial_il` stays light."""

import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(not (ROOT / "pyproject.toml").exists(), reason="not a checkout")
def test_layers() -> None:
    code = "from importlinter.cli import lint_imports; import sys; sys.exit(lint_imports())"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def first_circle(imports: dict[str, set[str]]) -> list[str]:
    """Return modules that import each other in a ring, first and last the same; none where there is no ring."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = grimp.build_graph("aerial_il", exclude_type_checking_imports=True, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    assert len(imports) > 100
    assert first_circle(imports) == []
    dataset, reader = "aerial_il.data.dataset", "aerial_il.data.episode"
    assert set(first_circle(imports | {reader: imports[reader] | {dataset}})) >= {dataset, reader}  # one would be found


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, aerial_il;"
        "sys.exit(str({'torch', 'mujoco', 'lerobot', 'hydra', 'gymnasium', 'numba'} & set(sys.modules) or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_every_folder_of_code_is_a_package_that_git_keeps() -> None:
    """An ignored ``__init__.py`` is on this disk and missing from a clone."""
    folders = {path.parent for path in (ROOT / "aerial_il").rglob("*.py")}
    assert [str(folder) for folder in folders if not (folder / "__init__.py").is_file()] == []
    git = ["git", "-C", str(ROOT), "ls-files", "--others", "--ignored", "--exclude-standard", "aerial_il", "tests"]
    result = subprocess.run(git, capture_output=True, text=True, check=False)
    if result.returncode:
        pytest.skip("this is no git checkout")
    assert [line for line in result.stdout.splitlines() if "__pycache__" not in line] == []
