"""The viewer's layout: which views there are and where."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from aerial_il.presentation.rerun.flight import Flight
from aerial_il.presentation.rerun.geometry import plain
from aerial_il.presentation.rerun.log import SIM_TIME
from aerial_il.presentation.rerun.scene import scene_view
from aerial_il.presentation.rerun.signals import groups_of

ALONE = ("reward", "forces/contact", "wind")  # plots of one curve, which is named by its tab
ROWS = {"pictures": 1.2, "action": 1.4, "observation": 1.1, "forces": 1.0, "reward": 0.7}  # shares of the height
LEGEND = rrb.PlotLegend(rrb.Corner2D.RightTop)


def blueprint(flights: dict[str, Flight], timeline: str = SIM_TIME) -> rrb.Blueprint:
    """Return the layout for flights, each below its root, side by side.

    Args:
        flights: root -> flight, as they were logged. timeline: that is shown first.
    """
    left = rrb.Horizontal(*(_left(root, flight) for root, flight in flights.items()))
    column = _right(flights)
    right = rrb.Vertical(*column.values(), row_shares=[ROWS[name] for name in column])
    shares = [1.5, 1] if len(flights) == 1 else [2.2, 1]
    panels = (panel(state="collapsed") for panel in (rrb.TopPanel, rrb.BlueprintPanel, rrb.SelectionPanel))
    time = rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused")
    return rrb.Blueprint(rrb.Horizontal(left, right, column_shares=shares), *panels, time, auto_views=False)


def _left(root: str, flight: Flight) -> rrb.Vertical:
    lanes = rrb.StateTimelineView(origin=f"/{root}states", name=f"{root}states")
    return rrb.Vertical(_scene(root, flight), lanes, row_shares=[3, 1.4])


def _scene(root: str, flight: Flight) -> rrb.Container | rrb.View:
    name = root.rstrip("/") or f"{flight.episode.spec.task} on {flight.episode.spec.robot}"
    if flight.motion is None:
        return rrb.TextDocumentView(origin=f"/{root}about", name=name)
    return rrb.Tabs(
        scene_view(f"/{root}scene", flight.motion, name), rrb.TextDocumentView(origin=f"/{root}about", name="about")
    )


def _right(flights: dict[str, Flight]) -> dict[str, rrb.Container | rrb.View]:
    """Return the column of pictures and curves, by name."""
    column: dict[str, rrb.Container | rrb.View] = {}
    if pictures := _pictures(flights):
        column["pictures"] = rrb.Horizontal(*pictures)
    column["action"] = _actions(flights)
    fields = [_curves(flights, f"observation/{plain(name)}", name) for name in _fields(flights)]
    column["observation"] = rrb.Tabs(*fields, name="observation")
    if forces := _forces(flights):
        column["forces"] = rrb.Tabs(*forces)
    column["reward"] = _curves(flights, "reward", "reward")
    return column


def _pictures(flights: dict[str, Flight]) -> list[rrb.View]:
    views: list[rrb.View] = []
    for root, flight in flights.items():
        below = f"/{root}scene/cameras" if flight.motion is not None else f"/{root}pictures"
        views += [rrb.Spatial2DView(origin=f"{below}/{name}", name=f"{root}{name}") for name in flight.cameras]
    return views


def _actions(flights: dict[str, Flight]) -> rrb.Tabs:
    """Return a tab for each group of the first flight's action: what was commanded, executed and predicted."""
    action = next(iter(flights.values())).episode.spec.action
    groups = [group.name for group in groups_of(action)]
    return rrb.Tabs(*(_curves(flights, f"action/{name}", f"action {name}") for name in groups), name="action")


def _fields(flights: dict[str, Flight]) -> Sequence[str]:
    """Return the observed fields, joints first."""
    spec = next(iter(flights.values())).episode.spec
    fields = [field.name for field in spec.observation.fields if field.group != "image"]
    return sorted(fields, key=lambda name: not name.startswith("joint_pos"))


def _forces(flights: dict[str, Flight]) -> list[rrb.View]:
    motions = [flight.motion for flight in flights.values() if flight.motion is not None]
    there = {
        "forces/contact": bool(motions),
        "forces/thrust": any(motion.thrust.size for motion in motions),
        "wind": any(motion.wind is not None for motion in motions),
    }
    return [_curves(flights, path, path.rpartition("/")[2]) for path, known in there.items() if known]


def _curves(flights: dict[str, Flight], path: str, name: str) -> rrb.TimeSeriesView:
    contents = [f"/{root}signals/{path}/**" for root in flights]
    named = len(flights) > 1 or path not in ALONE
    legend = LEGEND if named else rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=legend)
