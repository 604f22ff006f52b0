"""Costs of flights with an expert at hand: steps, queries, interventions, and how many succeeded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from aerial_il.data.episode import Episode


@dataclass(frozen=True)
class FlightCosts:
    """Counts over some flights.

    Attributes:
        flights, successes: how many. steps: control steps flown. queries: steps that the expert labelled.
        interventions: times that it took over. expert_steps: steps that it flew.
        solved_alone: successes in which it never took over.
    """

    flights: int = 0
    successes: int = 0
    steps: int = 0
    queries: int = 0
    interventions: int = 0
    expert_steps: int = 0
    solved_alone: int = 0

    def __add__(self, other: FlightCosts) -> FlightCosts:
        return FlightCosts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    @staticmethod
    def of(episodes: Sequence[Episode]) -> FlightCosts:
        return FlightCosts(
            flights=len(episodes),
            successes=sum(e.success for e in episodes),
            steps=sum(map(len, episodes)),
            queries=sum(int(e.asked.sum()) for e in episodes),
            interventions=sum(map(_interventions, episodes)),
            expert_steps=sum(int(e.is_intervention.sum()) for e in episodes),
            solved_alone=sum(e.success and not e.is_intervention.any() for e in episodes),
        )


def metrics_of(rounds: Sequence[FlightCosts], demos: Sequence[Episode], dataset: Sequence[Episode]) -> dict[str, float]:
    """Return what the newest of ``rounds`` cost and what all of them did.

    Args:
        rounds: costs of each round so far. demos: the demonstrations before them. dataset: all labelled episodes.
    """
    newest = rounds[-1] if rounds else FlightCosts()
    queries = sum(costs.queries for costs in rounds)
    return {
        "flights": newest.flights,
        "flights_solved": newest.successes,
        "flight_steps": newest.steps,
        "queries": newest.queries,
        "interventions": newest.interventions,
        "expert_steps": newest.expert_steps,
        "total/queries": queries,
        "total/labelled_steps": sum(map(len, demos)) + queries,
        "total/episodes": len(demos) + sum(costs.flights for costs in rounds),
        "total/labelled_episodes": len(dataset),
    }


def _interventions(episode: Episode) -> int:
    return int((np.diff(episode.is_intervention, prepend=False) & episode.is_intervention).sum())
