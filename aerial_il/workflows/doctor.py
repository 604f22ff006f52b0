"""What works on this machine: versions, cores, rendering, links to robots, free disk space."""

import shutil
from dataclasses import dataclass
from typing import Any

PAGE = "docs/troubleshooting.md"
LITTLE_DISK_GB = 5.0
PACKAGES_NEEDED = ("aerial-il", "mujoco", "dm-control", "numpy", "numba", "torch", "lerobot")


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Nothing need be said."""


def findings() -> dict[str, Any]:
    """Return versions, machine, the result of rendering one frame with each back end, links, and free space."""
    from aerial_il.core import registry, rendering
    from aerial_il.core.provenance import provenance

    problems = {backend: rendering.probe_backend(backend) or "works" for backend in rendering.BACKENDS}
    return {
        **provenance(),
        "rendering": {"chosen": rendering.choose_backend() or "MuJoCo's own choice", **problems},
        "links": {name: registry.get("link", name)().missing() or "works" for name in registry.names("link")},
        "free_disk_gb": round(shutil.disk_usage(".").free / 1e9, 1),
    }


def advice(result: dict[str, Any]) -> dict[str, str]:
    """Return finding -> what it means here and what to do, of those that are not as they could be."""
    from aerial_il.core.rendering import BACKENDS, PACKAGES

    rendering, notes = result["rendering"], {}
    if all(rendering[backend] != "works" for backend in BACKENDS):
        notes["rendering"] = f"Cameras and videos are off. To have them: sudo apt-get install -y {PACKAGES}; make setup"
    elif rendering["chosen"] in BACKENDS and rendering[rendering["chosen"]] != "works":
        notes["rendering"] = f"MUJOCO_GL={rendering['chosen']} does not work, another does: unset it, or make setup"
    if missing := [name for name in PACKAGES_NEEDED if name not in result["packages"]]:
        notes["packages"] = f"{', '.join(missing)} is not installed: make setup"
    if result["git"] and result["git"]["dirty"]:
        notes["git"] = "Files differ from the commit that recordings and results will name: commit before a study."
    if result["free_disk_gb"] < LITTLE_DISK_GB:
        notes["free_disk_gb"] = "Little is left. What meets a full disk says so, and the same command goes on later."
    if (result["cpu_count"] or 1) < 2:
        notes["cpu_count"] = "One core: all works, at half the speed that these pages give, or less."
    if not result["platform"].startswith("Linux"):
        notes["platform"] = "Only Linux has been tried."
    return notes
