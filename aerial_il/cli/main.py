"""The console script ``aerial-il``: finds the command, runs it, turns errors into one paragraph and an exit status."""

import atexit
import errno
import gc
import logging
import os
import signal
import sys
from functools import cache

from aerial_il.cli import commands
from aerial_il.core.errors import AerialError, shortened
from aerial_il.core.interruption import heard

OK, FAILED, BAD_USAGE = 0, 1, 2
MISTYPED = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EEXIST)  # said of a path
REMEDIES = {
    errno.ENOSPC: "make room",
    errno.EDQUOT: "make room",
    errno.EFBIG: "allow larger files (ulimit -f)",
    errno.EROFS: "choose a place that can be written to",
    errno.EACCES: "choose a place that you may use",
}


def main(argv: list[str] | None = None) -> int:
    """Run one command line.

    Args:
        argv: words after ``aerial-il``, those of the process if left out.

    Returns:
        0 only if the work was done; 2 for a mistake of the user's or bad data; 1 for a failure of the machine;
        130 and 143 after an interrupt (Ctrl-C) and a termination signal.
    """
    words = sys.argv[1:] if argv is None else argv
    _leave_at_once()
    try:
        with heard():
            return _dispatch(words)
    except AerialError as error:
        _complain(f"aerial-il: {error}")
        return getattr(error, "status", BAD_USAGE)
    except KeyboardInterrupt:
        _complain("\naerial-il: interrupted. The same command continues where this one stopped.")
        return 128 + signal.SIGINT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        if error.errno in MISTYPED:
            _complain(f"aerial-il: {_of_a_path(error)}.")
            return BAD_USAGE
        if (remedy := REMEDIES.get(error.errno or 0)) is None:
            raise
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        _complain(f"aerial-il: {what}. What was finished is whole; {remedy} and run the same command again.")
        return FAILED


@cache
def _leave_at_once() -> None:
    """Spare the end of this process a search for cycles among all that numba, torch and others left: seconds."""
    atexit.register(gc.freeze)


def _dispatch(words: list[str]) -> int:
    name, rest = (words[0], words[1:]) if words else ("--help", [])
    if name in ("completion", "_complete"):
        print(_completed(name, rest))
        return OK

    from aerial_il.cli import help

    if name in ("-h", "--help"):
        print(help.overview())
    elif name == "help":
        print(help.reference())
    elif name in ("-V", "--version"):
        print(help.version())
    elif name == "_job":
        _run_job(rest)
    elif {"-h", "--help"} & set(rest):
        print(help.of_command(commands.find(name), rest))
    else:
        command = commands.find(name)
        _log_to_stderr()
        from aerial_il.cli.running import run_command
        from aerial_il.core.rendering import check_backend

        check_backend()
        run_command(command, rest)
    return OK


def _completed(name: str, words: list[str]) -> str:
    """Return what the shell asks for: the script that completes, or the candidates for a word."""
    from aerial_il.cli import completion

    return (
        completion.script(words[0] if words else "bash")
        if name == "completion"
        else "\n".join(completion.candidates(words))
    )


def _run_job(words: list[str]) -> None:
    """Run one job of a sweep: a command, and its words as Hydra reads them."""
    from aerial_il.cli.compose import perform
    from aerial_il.cli.sweeps.job import end_with_parent

    _log_to_stderr()
    end_with_parent()
    perform(words[0], words[1:])


def _log_to_stderr() -> None:
    handler = logging.StreamHandler()
    handler.setFormatter(_PlainFormatter())
    logger = logging.getLogger("aerial_il")
    logger.handlers, logger.propagate = [handler], False  # absl's root handler would say everything twice
    logger.setLevel(logging.INFO)


class _PlainFormatter(logging.Formatter):
    """Only what is not routine carries its level."""

    def format(self, record: logging.LogRecord) -> str:
        text = record.getMessage()
        return text if record.levelno <= logging.INFO else f"{record.levelname.capitalize()}: {text}"


def _of_a_path(error: OSError) -> str:
    """Return what is wrong with a path, which some libraries do not name apart from their message."""
    if error.filename is None:
        return shortened(str(error).rstrip("."), 300)
    return f"{shortened(str(error.filename))} cannot be such a path: {error.strerror}"


def _complain(text: str) -> None:
    print(text, file=sys.stderr)
