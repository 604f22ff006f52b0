"""Fields of what tasks show, by how a robot would know them: seen, felt, or given by its user."""

from __future__ import annotations

from aerial_il.core.specs import Field

XYZ, COS_SIN = ("x", "y", "z"), ("cos", "sin")
SEEN = "bias and noise of the object's pose, seen late; exact without `estimation`"
SPEED = "noise of the object's position over its correlation time, seen late; exact without `estimation`"
FELT = "bias and white noise of a force sensor; exact without `estimation`"
GIVEN = "exact: the user gives it"
OWN = "that of the robot's own estimate, see `base_pos`"
EXACT = "exact in every tier"


def seen(
    name: str,
    meaning: str,
    size: int = 3,
    *,
    unit: str = "m",
    frame: str = "world",
    labels: tuple[str, ...] | None = None,
    noise: str = SEEN,
    real: bool = True,
    onboard: bool = False,
) -> Field:
    """Return a field of ``size`` numbers that cameras show; three are along x, y and z unless ``labels`` says else."""
    labels = (XYZ if size == 3 else ()) if labels is None else labels
    told = {"unit": unit, "labels": labels, "frame": frame, "meaning": meaning, "noise": noise}
    return Field(name, (size,), "task", **told, real=real, onboard=onboard)


def velocity(name: str, meaning: str, filter_s: float) -> Field:
    """Return the field of a velocity that a filter of ``filter_s`` s gets from what is seen, m/s."""
    return seen(name, meaning, unit="m/s", noise=f"a low-pass of {filter_s} s; {SPEED}")


def felt(name: str, meaning: str, size: int = 3, *, frame: str = "world", real: bool = True) -> Field:
    """Return a field of contact forces, N."""
    return seen(name, meaning, size, unit="N", frame=frame, noise=FELT, real=real)


def wrist_force(name: str = "wrist_force") -> Field:
    """Return the field of what a robot feels at its wrist, N."""
    meaning = "contact force of the gripper on other things"
    return seen(name, meaning, unit="N", noise=FELT, real=False, onboard=True)


def direction(name: str, meaning: str, *, labels: tuple[str, ...] = ("x", "y"), noise: str = SEEN) -> Field:
    """Return a field of a horizontal unit vector, or of cosine and sine."""
    return seen(name, meaning, 2, unit="", labels=labels, noise=noise)
