"""The demonstrations that a run was cloned from, once it is certain that the dataset is the same still."""

from pathlib import Path

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.selection import Selection
from aerial_il.algorithms.supervised.training_set import (
    Demonstrations,
    cut_windows,
    digest_of,
    hidden_in,
    labels_in,
    window_weights,
)
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading
from aerial_il.data.waypoints import Waypoints
from aerial_il.evaluation.training_run import TrainingRun
from aerial_il.policies import load_policy
from aerial_il.workflows.parts import demonstrations


def learned_from(run: TrainingRun, dataset: str | None) -> Demonstrations:
    """Return what a run learned from and what it held out.

    Args:
        run: by ``bc``. dataset: where its demonstrations are; None for where the run says.

    Raises:
        InvalidValueError: another algorithm trained it, or the dataset is not, or no longer, its own.
    """
    settings = run.config.get("settings", {})
    recorded = run.command.get("dataset", {})
    path = dataset or recorded.get("path")
    if run.algorithm != "bc" or "selection" not in settings:
        raise InvalidValueError(f"which demonstrations {run.algorithm} learned from, and held out, is not known.")
    if path is None:
        raise InvalidValueError("the run does not state where its dataset is. Give dataset=PATH.")
    policy = load_policy(run.path).config
    algorithm = BC(
        selection=Selection(**settings["selection"]),
        waypoints=Waypoints(**settings["waypoints"]) if "waypoints" in settings else BC.waypoints,
        validation=settings["validation"],
    )
    own = recorded.get("path")
    said = recorded if own is not None and Path(path).resolve() == Path(own).resolve() else {}
    episodes = demonstrations.open_demonstrations(
        path,
        limit=said.get("episodes"),
        **{name: said[name] for name in ("others", "weights", "latency_ms", "language") if name in said},
        images=policy.images,
        failures=algorithm.failures,
        reading=Reading(**said.get("reading", {})),
    )
    divided = algorithm.divide(episodes, policy, seed=run.seed)
    windows = cut_windows(divided.kept, divided.layout, policy)
    labels = labels_in(divided, hidden_in(divided, settings.get("auxiliary", 0.0)))
    if digest_of(windows, window_weights(divided.weights, windows), labels) != run.config["dataset"]["digest"]:
        raise InvalidValueError(f"{path} is not, or no longer, the dataset that the run was trained on.")
    return divided
