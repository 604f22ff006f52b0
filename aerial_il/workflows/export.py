"""A policy as a folder that flies with NumPy and onnxruntime alone."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.parts.names import License

if TYPE_CHECKING:
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy

log = logging.getLogger(__name__)
TOLERANCE = 1e-4  # of normalised actions, between the graph and the network


@dataclass(frozen=True, kw_only=True)
class Export:
    """What is exported, and where to.

    Attributes:
        policy: a run or a policy.
        out: folder for network.onnx, exported.json and README.md.
        evaluation: result that the README states (null: that of the run's folder, if there is one).
        license: under which the policy may be used (null: none is stated).
    """

    policy: str
    out: str
    evaluation: str | None = None
    license: License | None = None


@dataclass(frozen=True)
class Exported:
    """The folder, the size of the graph, and the largest difference from the network in normalised actions."""

    folder: Path
    graph_bytes: int
    difference: float


def export(settings: Export) -> Exported:
    """Write the folder, and compare what it answers with what the network answers.

    Raises:
        InvalidValueError: the folder holds what is somebody else's; the policy is made of several networks; the graph
            answers otherwise than the network; onnx or onnxruntime is missing. CheckpointError: there is no policy.
    """
    from aerial_il.core.files import write_atomic, write_json
    from aerial_il.core.places import claim_folder
    from aerial_il.evaluation.result import load_result
    from aerial_il.policies import load_policy
    from aerial_il.policies.parts.exported import CARD, DESCRIPTION, GRAPH, described, load_exported
    from aerial_il.policies.parts.onnx_graph import apart, onnx_of
    from aerial_il.presentation.model_card import model_card

    out = claim_folder(settings.out, (DESCRIPTION, CARD), (GRAPH, DESCRIPTION, CARD))
    policy = load_policy(settings.policy)
    place = _evaluation(settings)
    result = _own_result(load_result(place), policy, settings) if place else None
    graph = onnx_of(policy)
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(out / GRAPH, graph)
    write_json(out / DESCRIPTION, described(policy, graph))
    difference = apart(policy, load_exported(out))
    if not difference <= TOLERANCE:
        (out / DESCRIPTION).unlink()  # it could be flown
        raise InvalidValueError(
            f"{out / GRAPH} answers otherwise than the network, by {difference:.2g} in normalised actions, where "
            f"{TOLERANCE:g} is allowed. It cannot be flown; report the policy's class, {policy.config.name}."
        )
    write_atomic(out / CARD, model_card(policy, title=out.resolve().name, result=result, license=settings.license))
    return Exported(out, len(graph), difference)


def _own_result(result: EvaluationResult, policy: ChunkPolicy, settings: Export) -> EvaluationResult | None:
    """Return the result if these weights flew it: a run that was trained anew still has the one of before beside it.

    Raises:
        InvalidValueError: they did not, and it was asked for.
    """
    from aerial_il.evaluation.rollouts import weights_of

    if result.provenance.get("policy_sha256") == weights_of(policy):
        return result
    if settings.evaluation:
        raise InvalidValueError(
            f"evaluation={settings.evaluation} was flown by other weights than {settings.policy} has."
        )
    log.warning("The evaluation beside %s was flown by other weights: the card says not evaluated.", settings.policy)
    return None


def _evaluation(settings: Export) -> Path | None:
    """Return the folder of the result to state."""
    from aerial_il.evaluation.result import FILE_NAME

    if settings.evaluation:
        return Path(settings.evaluation)
    own = Path(settings.policy) / "evaluation"
    return own if (own / FILE_NAME).is_file() else None
