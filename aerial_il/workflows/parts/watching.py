"""``rerun=true``: the first world of what flies now is shown in rerun."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic
from aerial_il.suite.batch import BatchEnvironment

log = logging.getLogger(__name__)
RECORDED = Path("runs/inspections/live.rrd")


@contextmanager
def watched[Env: BatchEnv](env: Env, threads: int, *, wanted: bool) -> Iterator[Env | BatchEnvironment]:
    """Yield ``env`` itself, or what stands for it and is watched; a file is written where there is no screen.

    Raises:
        InvalidValueError: its worlds are not the suite's. ViewerError: rerun's viewer is not installed.
    """
    if not wanted:
        yield env
        return
    if not isinstance(env, BatchEnvironment):
        raise InvalidValueError(f"rerun=true works in this suite only; {env.spec.robot}/{env.spec.task} is external.")
    import rerun as rr

    from aerial_il.presentation.films.window import has_screen
    from aerial_il.presentation.rerun.live import WatchedBatch
    from aerial_il.presentation.rerun.program import program

    stream = rr.RecordingStream("aerial_il-live")
    sent = None if has_screen() else stream.binary_stream()  # on a full disk rerun's own writer can wait for ever
    if sent is None:
        rr.spawn(executable_path=str(program()), recording=stream)
    else:
        print(f"No screen here: what flies is written to {RECORDED} in the end")
    shown = WatchedBatch(env, threads, stream)
    try:
        yield shown
    finally:
        shown.close()
        stream.flush()
        if sent is not None:
            _keep(sent.read() or b"")
        stream.disconnect()


def _keep(recording: bytes) -> None:
    """Write what was shown; where that fails the flights themselves are kept."""
    try:
        write_atomic(RECORDED, recording)
    except OSError as error:
        log.warning("%s: what flew could not be written (%s).", RECORDED, error)
