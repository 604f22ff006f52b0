"""An earlier commit of this package as a peer: its own code in a process of its own, asked over a pipe.

Both sides of a comparison run the same script, each with the package of its checkout, so that only that differs::

    SCRIPT = '''
    import aerial_il
    env = aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=256)

    def fly(seed, steps): ...                  # takes and returns JSON values
    '''
    with Checkout.here().serve(SCRIPT) as ours, Checkout(parent).serve(SCRIPT) as theirs:
        ratio = theirs.ask("fly", seed=1, steps=60) / ours.ask("fly", seed=1, steps=60)

A process stays up as long as its context lasts: what the script has loaded stays loaded, and turns can be taken.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aerial_il
from aerial_il.core.errors import AerialError, InvalidValueError

ROOT = Path(aerial_il.__file__).resolve().parents[1]
READY = "ready"
# Answers leave by a descriptor of their own: what libraries print goes to stderr.
SERVER = """
import json, os, sys
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
import aerial_il
names = {"__name__": "__main__"}
exec(compile(sys.argv[1], "<script>", "exec"), names)
names["ready"] = lambda: aerial_il.__file__
for line in sys.stdin:
    function, arguments = json.loads(line)
    print(json.dumps(names[function](**arguments)), file=answers, flush=True)
"""


class PeerError(AerialError):
    """The process of a checkout ended instead of answering; its traceback is on stderr."""


class Peer:
    """A process that answers questions.

    Args:
        process: runs :data:`SERVER`. name: of its checkout, for errors.
    """

    def __init__(self, process: subprocess.Popen[str], name: str) -> None:
        self._process, self._name = process, name

    def ask(self, function: str, **arguments: Any) -> Any:
        """Call a function of the script and wait for what it returns; both ways JSON values.

        Raises:
            PeerError: the script failed.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps([function, arguments]) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise PeerError(f"{self._name}: {function} failed with exit status {self._process.wait()}; see above.")
        return json.loads(line)


@dataclass(frozen=True)
class Checkout:
    """A folder that holds some commit of this repository.

    Args:
        path: the folder. python: interpreter that has the packages this commit needs.
        environ: environment variables besides those of this process.

    Raises:
        InvalidValueError: there is no such package, or no such interpreter.
    """

    path: Path
    python: str = sys.executable
    environ: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (self.path / "aerial_il" / "__init__.py").is_file():
            raise InvalidValueError(
                f"{self.path} holds no aerial_il. Make a checkout with: git worktree add PATH COMMIT"
            )
        if not os.access(self.python, os.X_OK):
            raise InvalidValueError(f"{self.python} is no interpreter; leave it out to use {sys.executable}.")

    @staticmethod
    def here(environ: Mapping[str, str] | None = None) -> Checkout:
        """Return the checkout that is running now."""
        return Checkout(ROOT, environ=environ or {})

    @property
    def commit(self) -> str:
        """The commit it stands at, ten characters and ``+`` where files were changed since; ``unknown`` without git."""
        git = ["git", "-C", str(self.path)]
        sha = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=False).stdout[:10]
        changed = subprocess.run([*git, "status", "--porcelain", "-uno"], capture_output=True, text=True, check=False)
        return sha + "+" * bool(changed.stdout) if sha else "unknown"

    @contextmanager
    def serve(self, script: str) -> Iterator[Peer]:
        """Run ``script``, which defines functions, and answer questions to them as long as the context lasts.

        Raises:
            PeerError: the script failed, or another package than this checkout's was imported.
        """
        environ = {**os.environ, **self.environ, "PYTHONPATH": str(self.path.resolve())}
        command = [self.python, "-P", "-c", SERVER, script]  # -P: the working folder must not hide the checkout
        pipe = subprocess.PIPE
        with subprocess.Popen(command, cwd=self.path, env=environ, stdin=pipe, stdout=pipe, text=True) as process:
            try:
                peer = Peer(process, str(self.path))
                if not Path(peer.ask(READY)).is_relative_to(self.path.resolve()):
                    raise PeerError(f"{self.python} imports another aerial_il than that of {self.path}.")
                yield peer
                assert process.stdin is not None
                process.stdin.close()
                process.wait()
            finally:
                process.kill()


def turns(peers: Mapping[str, Peer], repetitions: int, function: str, **arguments: Any) -> dict[str, list[Any]]:
    """Ask every peer the same once per repetition, one right after the other.

    Returns:
        peer -> its answers; a first round, which warms caches up, is left out.
    """
    rounds = [{name: peer.ask(function, **arguments) for name, peer in peers.items()} for _ in range(repetitions + 1)]
    return {name: [answers[name] for answers in rounds[1:]] for name in peers}
