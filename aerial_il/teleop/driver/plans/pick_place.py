"""Pick and place by hand: over the cube, down, close, up, over the bowl, down, open, away; again if it slips.

A tool that leans, as a policy may leave it, is straightened first, above the cube: its fingers would push it away.
"""

import math
from dataclasses import replace

from aerial_il.teleop.driver.eyes import Sight
from aerial_il.teleop.driver.habit import Habit
from aerial_il.teleop.driver.plan import Wish

BEND_FROM_M = 0.16  # farther away than this, the way there bends to the side
OVER_M, ASKEW_M = 0.013, 0.035  # beside the cube: good enough to go down, and bad enough to go up again
FACING_RAD = 0.12
AT_CUBE_M = 0.008
LOWEST_M = 0.09  # above the cube, so that open fingers pass over it
AROUND_M, HALF_CLOSED = 0.03, 0.6  # the fingers are about the cube; they are closing: no reason to open them
GIVEN_UP_TICKS, TRIES = 70, 3  # a grasp takes so long at most; beside the bowl's rim none succeeds
FAILED = ("close", "over"), ("down", "over")  # a grasp that failed; fingers that met something else
LONGEST_TICKS = 1_200  # without a grasp
LEANS_RAD, STRAIGHT_RAD, STRAIGHTENING_TICKS = 0.2, 0.08, 150
OVER_BOWL_M = 0.02
LET_GO_M = 0.052  # the cube's centre over the bowl's underside
OPEN = 0.85


class PickPlacePlan:
    """Works part by part, by what is seen; a cube that is not where it should be is fetched again."""

    def begin(self, sight: Sight, habit: Habit) -> None:
        self._habit, self._ticks, self._failed, self._empty, self._straightens = habit, 0, 0, 0, True
        self._part = _part_at(sight)
        ahead, left, up = sight.numbers["tool to cube"]
        near = math.hypot(ahead, left) < BEND_FROM_M
        self._straight = near or sight.status.subtasks["grasped"]
        self._height = min(habit.height, max(-up, LOWEST_M)) if near else habit.height  # nobody goes up to go down

    def wish(self, sight: Sight) -> Wish:
        after = self._next(sight)
        self._failed += (self._part, after) in FAILED
        self._empty = 0 if sight.status.subtasks["grasped"] else self._empty + 1
        self._ticks = self._ticks + 1 if after == self._part else 0
        self._part = after
        wish = getattr(self, f"_{after}")(sight)
        return replace(wish, hopeless=self._failed >= TRIES or self._empty > LONGEST_TICKS)

    def left(self, sight: Sight) -> float:
        ahead, left, up = sight.numbers["cube to bowl"]
        flags = sight.status.subtasks
        if flags["in_bowl"] and not flags["grasped"]:
            return -math.hypot(*sight.numbers["tool to cube"])
        if flags["grasped"]:
            return math.hypot(ahead, left) + 0.3 * abs(up)
        return 1.0 + math.hypot(*sight.numbers["tool to cube"])

    def _next(self, sight: Sight) -> str:
        flags, part, ticks = sight.status.subtasks, self._part, self._ticks
        ahead, left, up = sight.numbers["tool to cube"]
        beside, turn = math.hypot(ahead, left), abs(sight.numbers["turn to cube"][0])
        to_bowl, height = math.hypot(*sight.numbers["cube to bowl"][:2]), -sight.numbers["cube to bowl"][2]
        slipped = ticks > 15 and not flags["grasped"] and math.hypot(ahead, left, up) > 0.035
        if flags["in_bowl"] and part in ("over", "down"):
            return "away"
        leans = max(map(abs, _leaning(sight)))
        match part:
            case "over" | "down" if self._straightens and leans > LEANS_RAD and ticks > 10:
                return "straighten"
            case "straighten" if leans < STRAIGHT_RAD or ticks > STRAIGHTENING_TICKS:
                self._straightens = ticks <= STRAIGHTENING_TICKS  # what is out of the arm's reach is let be
                return "over"
            case "over" if beside < OVER_M and turn < FACING_RAD and abs(-up - self._height) < 0.05:
                return "down"
            case "down" if beside > ASKEW_M:
                return "over"
            case "down" if -up < AT_CUBE_M and beside < OVER_M + 0.005:
                return "close"
            case "close" if flags["grasped"] and ticks > 10:
                return "lift"
            case "close" if ticks > GIVEN_UP_TICKS:
                return "over"
            case "lift" | "carry" if slipped:
                return "over"
            case "lift" if height > self._habit.height:
                return "carry"
            case "carry" if to_bowl < OVER_BOWL_M:
                return "lower"
            case "lower" if to_bowl > 0.05:
                return "carry"
            case "lower" if height < LET_GO_M or slipped:
                return "release"
            case "release" if sight.numbers["gripper"][0] > OPEN:
                return "away"
            case "away" if ticks > 75 and not flags["in_bowl"]:
                return "over"
        return part

    def _over(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["tool to cube"]
        turn = sight.numbers["turn to cube"][0]
        distance, bend = math.hypot(ahead, left), 0.0
        if distance < BEND_FROM_M:
            self._straight = True
        if not self._straight:
            bend = self._habit.side
        if self._habit.turns_first and abs(turn) > 0.3:
            return Wish("over", turn=(turn, 0.0, 0.0), grip=-1)
        # the bend is across the way there
        across = (-left / max(distance, 1e-6), ahead / max(distance, 1e-6))
        offset = (ahead + bend * across[0], left + bend * across[1], up + self._height)
        turned = turn if distance < 0.2 or self._habit.turns_first else 0.0
        return Wish("over", offset, (turned, 0.0, 0.0), grip=-1, fine=math.hypot(*offset) < 0.05)

    def _straighten(self, sight: Sight) -> Wish:
        nose, roll = _leaning(sight)
        up = max(0.0, LOWEST_M + sight.numbers["tool to cube"][2])
        return Wish("straighten", (0.0, 0.0, up), (0.0, -nose, -roll), grip=-1, mode="wrist")

    def _down(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["tool to cube"]
        aside = math.hypot(ahead, left) > OVER_M + 0.007
        turn = sight.numbers["turn to cube"][0]
        return Wish("down", (ahead, left, 0.0 if aside else up), (turn, 0.0, 0.0), grip=-1, fine=-up < 0.07)

    def _close(self, sight: Sight) -> Wish:
        return Wish("close", grip=1, fine=True)

    def _lift(self, sight: Sight) -> Wish:
        height = -sight.numbers["cube to bowl"][2]
        return Wish("lift", (0.0, 0.0, self._habit.height + 0.03 - height), grip=1, unfinished=True)

    def _carry(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["cube to bowl"]
        return Wish("carry", (ahead, left, self._habit.height + up), grip=1, fine=math.hypot(ahead, left) < 0.05)

    def _lower(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["cube to bowl"]
        return Wish("lower", (ahead, left, up + LET_GO_M - 0.015), grip=1, fine=-up < 0.12)

    def _release(self, sight: Sight) -> Wish:
        return Wish("release", grip=-1, fine=True)

    def _away(self, sight: Sight) -> Wish:
        return Wish("away", (0.0, 0.0, 0.2), grip=-1)


def _part_at(sight: Sight) -> str:
    """Return the part in whose midst the flight is."""
    if sight.status.subtasks["grasped"]:
        return "lower" if math.hypot(*sight.numbers["cube to bowl"][:2]) < 0.05 else "lift"
    if math.hypot(*sight.numbers["tool to cube"]) < AROUND_M:
        return "close" if sight.numbers["gripper"][0] < HALF_CLOSED else "down"
    return "over"


def _leaning(sight: Sight) -> tuple[float, float]:
    """Return by how much the nose and the right side are too far down for a tool that is to point straight down."""
    nose, left = sight.numbers["tool points"]
    return nose - 0.5 * math.pi, left


PLAN = PickPlacePlan
