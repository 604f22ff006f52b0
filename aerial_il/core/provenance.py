"""Provenance of a result: code, packages and machine, as plain values ready for JSON or YAML."""

import os
import platform
import subprocess
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("aerial-il", "mujoco", "dm-control", "numpy", "numba", "torch", "lerobot")


def provenance() -> dict[str, Any]:
    """Return what determines a result besides its own settings.

    Returns:
        ``packages`` (name -> version), ``git`` (``sha``, ``dirty``; None outside a checkout), ``python``,
        ``platform`` and ``cpu_count``. Equal on repeated calls in one process and free of user and host names.
    """
    return {
        "packages": package_versions(),
        "git": git_state(),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu_count": os.cpu_count(),
    }


def package_versions() -> dict[str, str]:
    """Return the installed versions of the packages that can change a result."""
    return {name: version for name in PACKAGES if (version := _version(name))}


@cache
def _git(*arguments: str) -> str | None:
    folder = Path(__file__).resolve().parents[2]
    command = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def git_state() -> dict[str, Any] | None:
    """Return ``{"sha", "dirty"}`` of the checkout that the package runs from, or None if it is installed."""
    sha, tracked = _git("rev-parse", "HEAD"), _git("ls-files", "--error-unmatch", "pyproject.toml")
    if sha is None or tracked is None:
        return None
    return {"sha": sha, "dirty": bool(_git("status", "--porcelain", "--untracked-files=no"))}


@cache
def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
