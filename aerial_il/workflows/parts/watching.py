"""``rerun=true``: the first world of what flies now is shown in rerun."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.suite.batch import BatchEnvironment

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
    if has_screen():
        rr.spawn(executable_path=str(program()), recording=stream)
    else:
        RECORDED.parent.mkdir(parents=True, exist_ok=True)
        stream.save(RECORDED)
        print(f"No screen here: what flies is written to {RECORDED}")
    shown = WatchedBatch(env, threads, stream)
    try:
        yield shown
    finally:
        shown.close()
        stream.flush()
        stream.disconnect()
