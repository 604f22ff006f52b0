"""The content of a demonstration file: its topics, and what each step is made of.

=====================  ==========================  ==========================================================
topic                  type                        content
=====================  ==========================  ==========================================================
``/step``              aerial_il_msgs/Steps        all of T + 1 steps, column by column, up to 64 in a message; exact
``/observation``       JointState                  every state observation, named element by element
``/joint_states``      JointState                  the arm's joints, where the robot observes any
``/pose/<body>``       PoseStamped                 of each ``<body>_pos`` in metres, with ``<body>_rot6d`` if any
``/tf``                TFMessage                   the same poses as a tree under ``world``
``/action``            JointState                  the commanded action, named
``/reward``            Float64MultiArray           one element
``/<extra>``           JointState                  further numbers that it was asked to keep, e.g. ``/device``
``/camera/<name>``     CompressedImage             JPEG (RGB) or PNG (depth in mm, segmentation id + 1)
=====================  ==========================  ==========================================================

Only ``/step`` and the cameras have something of each step; the last of ``/step`` is the state in which the flight
ended, its outcome zero. All others say again, ten times a second, what stands there, for eyes, and are written when
the flight is over. ``log_time`` is simulation time.

"""

import json
from functools import cached_property

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.data.recording.encoding.topics import NO_EXTRAS, Block, Extras, place_of
from aerial_il.data.recording.views import Views

VERSION = 2
FLAGS = ("is_intervention", "terminated", "truncated")


class Layout:
    """What a step of one environment is made of, whichever way it is written down.

    Args:
        spec: the environment's specification.
        ctrl_size: number of actuator controls.
        extras: name -> labels of further numbers of each step, a topic of their own; most recordings have none.
    """

    def __init__(self, spec: EnvSpec, ctrl_size: int, extras: Extras = NO_EXTRAS) -> None:
        self.spec, self.ctrl_size = spec, ctrl_size
        self.extras = {name: tuple(labels) for name, labels in extras.items()}
        self.views = Views(spec, self.extras)

    @cached_property
    def row(self) -> np.dtype:
        """Structured dtype of one step: float64 numbers alone.

        First what a terminal step has too; then its outcome, of which all is finite; then the rest.
        """
        observed, action = self.spec.observation.size(self.spec.observation.state_names), self.spec.action.size
        sizes = {"observation": observed, "state": self.spec.state_size}
        outcome = {"ctrl": self.ctrl_size, "action": action, "executed_action": action}
        further = {"expert_action": action, **{name: len(labels) for name, labels in self.extras.items()}}
        numbers: list[tuple] = [
            ("sim_time", "<f8"),
            *((name, "<f8", (size,)) for name, size in sizes.items()),
            *((name, "<f8") for name in ("reward", "phase", *FLAGS)),
            *((name, "<f8", (size,)) for name, size in {**outcome, **further}.items()),
        ]
        return np.dtype(numbers)

    @cached_property
    def width(self) -> int:
        """Numbers of a step."""
        return self.row.itemsize // 8

    @cached_property
    def columns_json(self) -> str:
        """Names and sizes of what a step is made of, in order, as they stand in every file."""
        sizes = {name: place_of(self.row, name)[0].itemsize // 8 for name in self.row.names or ()}
        return json.dumps(sizes)

    @cached_property
    def seen_width(self) -> int:
        """Numbers of a step that are there before its action, and so of the last one, too; they come first."""
        return self._end_of("state")

    @cached_property
    def finite_width(self) -> int:
        """Numbers of a step that must be finite; they come first."""
        return self._end_of("executed_action")

    @cached_property
    def spec_json(self) -> str:
        """The specification as it stands in every file."""
        return json.dumps(self.spec.to_dict(), allow_nan=False)

    def field_of(self, flat: np.ndarray, name: str) -> np.ndarray:
        """Cut field ``name``, of ``(k, *shape)``, in its own dtype out of flat observations (k, Do)."""
        field = self.spec.observation[name]
        return flat[:, self.views.slices[name]].reshape(-1, *field.shape).astype(field.dtype, copy=False)

    def name_of_number(self, column: int) -> tuple[str, list[int]]:
        """Return the field that a number of the row belongs to, and where in it, for messages to people."""
        assert self.row.fields is not None
        for name, (dtype, first, *_) in self.row.fields.items():
            if first <= 8 * column < first + dtype.itemsize:
                return name, [column - first // 8] if dtype.shape else []
        raise IndexError(column)

    def rows(self, block: Block) -> np.ndarray:
        """Return a block's steps (k,) as rows; a field that is shorter, as an outcome may be, is zero at the end."""
        rows = np.zeros(len(block["sim_time"]), self.row)
        for name in block.keys() & set(self.row.names or ()):
            rows[name][: len(block[name])] = block[name]
        return rows

    def numbers(self, rows: np.ndarray) -> np.ndarray:
        """Show rows (k,) as their numbers (k, M)."""
        return rows.view(np.float64).reshape(len(rows), self.width)

    def _end_of(self, name: str) -> int:
        dtype, first = place_of(self.row, name)
        return (first + dtype.itemsize) // 8
