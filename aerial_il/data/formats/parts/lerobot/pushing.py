"""Push a LeRobot dataset to the Hugging Face Hub, by lerobot's own function."""

import os
from collections.abc import Sequence
from pathlib import Path

from aerial_il.core.errors import InvalidValueError

TOKEN = "HF_TOKEN"
OFFLINE = "HF_HUB_OFFLINE"


def require_reachable() -> None:
    """Require a token and leave to go online; to be called before anything of lerobot's is imported.

    Raises:
        InvalidValueError: one is missing.
    """
    if not os.environ.get(TOKEN, "").strip():
        raise InvalidValueError(f"repo= needs a token of the hub's that may write: export {TOKEN}=... first.")
    if os.environ.setdefault(OFFLINE, "0").lower() not in ("0", "false", "no", "off", ""):
        raise InvalidValueError(f"{OFFLINE}={os.environ[OFFLINE]} forbids repo=: unset it, or leave out repo=.")


def push(folder: Path, repo: str, *, license: str, tags: Sequence[str], private: bool, readme: Path) -> str:
    """Push a whole dataset and return its address; lerobot writes a README of its own, which ours then replaces.

    Args:
        folder: of the dataset. repo: ``NAME/SET``. license: as the hub spells it. tags: of the repository.
        private: whether a new repository is shown to its owner alone. readme: ours.

    Raises:
        InvalidValueError: the hub refused, or cannot be reached; the token is not in what is said.
    """
    from huggingface_hub import HfApi
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    try:
        dataset = LeRobotDataset(repo, root=folder, video_backend="pyav")
        dataset.push_to_hub(tags=[*tags], license=license, private=private)
        HfApi().upload_file(
            path_or_fileobj=readme, path_in_repo=readme.name, repo_id=repo, repo_type="dataset", commit_message="Card"
        )
    except Exception as error:  # of the hub, of the network, of lerobot: each raises its own kind
        said = f"{type(error).__name__}: {error}".replace(os.environ.get(TOKEN) or "\0", "***")
        raise InvalidValueError(
            f"repo={repo} could not be pushed ({said}). {folder} is complete: the same command pushes it again."
        ) from None
    return f"https://huggingface.co/datasets/{repo}"
