"""Pictures of the flight, made by a thread of its own from copies of the state: late ones are dropped, never ticks."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO

import mujoco
import numpy as np
from PIL import Image

from aerial_il.core.errors import UnknownNameError
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.rendering import Renderer
from aerial_il.teleop.web.chase import Chase

THRIFT = ((1, 72), (1, 45), (2, 60), (2, 35))  # pixels left out, and quality of the JPEGs, from wide to narrow links
MAX_RATE = 30.0  # pictures per second
CHASE = "chase"  # besides the cameras of the scene


@dataclass(frozen=True)
class Shot:
    """One moment as JPEGs.

    Attributes:
        number: counts the moments that were rendered. input_seq: last message that had its effect by then.
        taken: s, on ``time.perf_counter``. images: one for each camera.
    """

    number: int
    input_seq: int
    taken: float
    images: tuple[bytes, ...]


class Film:
    """Renders the latest state it was shown.

    Args:
        model: compiled scene. cameras: their names. size: (height, width). deliver: gets each shot, on the film's
            thread.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        cameras: Sequence[str],
        size: tuple[int, int],
        deliver: Callable[[Shot], None],
    ) -> None:
        known = (CHASE, *(model.camera(i).name for i in range(model.ncam)))
        if unknown := set(cameras) - set(known):
            raise UnknownNameError("camera", min(unknown), known)
        self._model, self.cameras, self._size = model, tuple(cameras), size
        self._deliver = deliver
        self._wake, self._ended = threading.Condition(), False
        self._shown: tuple[np.ndarray, int, float] | None = None
        self._thread = threading.Thread(target=self._run, name="film", daemon=True)
        self.error: BaseException | None = None
        self.thrift = 0  # which of ``THRIFT``; set by who knows the link
        self.watched = True  # whether anybody looks; set by who knows the pages

    def start(self) -> None:
        """Begin to render."""
        self._thread.start()

    def show(self, state: np.ndarray, input_seq: int) -> None:
        """Hand over a copy of the state (S,) to be rendered; one that was not rendered yet is forgotten.

        Nothing is rendered while nobody watches.
        """
        if not self.watched:
            return
        with self._wake:
            self._shown = (state, input_seq, time.perf_counter())
            self._wake.notify()

    def close(self) -> None:
        """End the thread, which frees its graphics context."""
        with self._wake:
            self._ended = True
            self._wake.notify()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        data, number, last = mujoco.MjData(self._model), 0, None
        renderer, chase = Renderer(self._model, *self._size), Chase(self._model)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = False
        try:
            while (taken := self._next()) is not None:
                started, (state, input_seq, when) = time.perf_counter(), taken
                mujoco.mj_setState(self._model, data, state, STATE)
                mujoco.mj_forward(self._model, data)
                still = (state.tobytes(), self.cameras)
                thrift, last = 0 if still == last else self.thrift, still  # what stands still is seen sharp
                images = tuple(_jpeg(_picture(renderer, chase, data, name), thrift) for name in self.cameras)
                number += 1
                self._deliver(Shot(number, input_seq, when, images))
                time.sleep(max(0.0, started + 1.0 / MAX_RATE - time.perf_counter()))
        except BaseException as error:
            self.error = error
            raise
        finally:
            renderer.close()

    def _next(self) -> tuple[np.ndarray, int, float] | None:
        with self._wake:
            self._wake.wait_for(lambda: self._shown is not None or self._ended)
            shown, self._shown = self._shown, None
            return None if self._ended else shown


def _picture(renderer: Renderer, chase: Chase, data: mujoco.MjData, camera: str) -> np.ndarray:
    """Return one picture (H, W, 3) of ``data``."""
    renderer.update_scene(data, camera=chase.aim(data) if camera == CHASE else camera)
    if camera == CHASE:
        chase.draw_plumb_line(renderer.scene, data)
    return renderer.render()


def _jpeg(image: np.ndarray, thrift: int) -> bytes:
    step, quality = THRIFT[thrift]
    target = BytesIO()
    Image.fromarray(image).reduce(step).save(target, "JPEG", quality=quality)
    return target.getvalue()
