"""The summary of a folder that people fly into, with the commands that go on from it."""

from pathlib import Path

from aerial_il.core.files import write_atomic
from aerial_il.core.places import claim_file
from aerial_il.presentation.pages.session import PAGE, session_page
from aerial_il.workflows import spelling
from aerial_il.workflows.spelling import command_line


def summary(folder: str) -> str:
    """Return the page about ``folder``."""
    said = [["validate", spelling.path("path", folder)], ["replay", f"path={folder}"], ["view", f"recording={folder}"]]
    training = ["train", "algorithm=bc", "policy=mlp", f"dataset={folder}", f"run=runs/{Path(folder).name}"]
    return session_page(folder, [command_line(words) for words in [*said, training]])


def write_summary(folder: str, out: str | None = None) -> Path:
    """Write that page, beside the recordings unless ``out`` says where else."""
    return write_atomic(claim_file(out or Path(folder) / PAGE), summary(folder))
