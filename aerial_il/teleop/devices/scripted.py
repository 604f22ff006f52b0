"""A script that flies as a person would, through the same frames: for tests, drivers and studies."""

from collections.abc import Callable, Collection
from itertools import count

from aerial_il.teleop.input.frame import DeviceFrame, bits_of
from aerial_il.teleop.input.mapping import DIRECTIONS, HELD, PRESSED, Bindings

CONTROLS = (*DIRECTIONS, *HELD, *PRESSED)  # each gives the command that it is named after
Script = Callable[[int], Collection[str]]


class Scripted:
    """Hold at tick k the controls that ``script(k)`` names.

    Args:
        script: tick -> names of controls. bindings: in whose order the frames' bits stand.
    """

    def __init__(self, script: Script, bindings: Bindings) -> None:
        self._script, self._controls = script, bindings.controls
        self._ticks, self._before = count(), 0

    def frame(self) -> DeviceFrame:
        tick = next(self._ticks)
        held = bits_of(self._script(tick), self._controls)
        edges, self._before = held & ~self._before, held
        return DeviceFrame(seq=tick + 1, held=held, edges=edges, t_client=20.0 * tick)
