"""Training on flights by hand: what of it differs from training on a script's, and the line that says so."""

import logging
from typing import TYPE_CHECKING, Any

from aerial_il.algorithms.bc import BC
from aerial_il.data.dataset import open_dataset
from aerial_il.data.provenance import flown_by_hand
from aerial_il.data.reading import AS_IT_SAYS, Reading
from aerial_il.data.waypoints import LEVEL, LOOKAHEAD_S, Waypoints
from aerial_il.policies.parts.egocentric import chose_view, egocentric

if TYPE_CHECKING:
    from aerial_il.policies.parts.network import PolicySettings

log = logging.getLogger(__name__)


def suited[P: PolicySettings](
    path: str | None, algorithm: Any, policy: P, *, by_hand: bool | None, reading: Reading = AS_IT_SAYS
) -> tuple[Any, P]:
    """Return settings that learn from the dataset as it was flown; those of the user's own choice are kept.

    Demonstrations that a person flew are relabelled (:mod:`aerial_il.data.waypoints`) and seen from the tool
    (:mod:`aerial_il.policies.parts.egocentric`); what was changed is logged.

    Args:
        path: of the dataset, if there is one. algorithm, policy: as they were configured.
        by_hand: whether to take it as flown by hand; None for what its provenance says.
        reading: answers to what the format does not say.
    """
    before: Waypoints | None = getattr(algorithm, "waypoints", None)  # of one that clones
    if path is None or before is None or by_hand is False:
        return algorithm, policy
    episodes = open_dataset(path, **reading.answers, failures=True, states=False).one_of_each()
    flown = [episode for episode in episodes if by_hand or flown_by_hand(episode.provenance)]
    if not flown or not (by_hand or all(e.spec.action.level == LEVEL for e in flown)):
        return algorithm, policy
    said = []
    if before == BC.waypoints:
        waypoints = Waypoints(lookahead_s=LOOKAHEAD_S, flown_by="anyone" if by_hand else "hand")
        algorithm = algorithm.relabelling(waypoints)
        said.append(f"no-ops left out, actions become the pose reached {LOOKAHEAD_S:g} s later")
    if not chose_view(policy):
        policy = egocentric(policy)
        said.append("the policy sees from the tool, without the robot's own pose")
    if said:
        who = ", ".join(sorted({str(e.provenance.get("policy", "unknown")) for e in flown}))
        log.info("Flown by hand (%s): %s. As recorded: dataset.by_hand=false", who, "; ".join(said))
    return algorithm, policy
