"""Draw the reward that a run has learned along one recorded episode, and print its mean.

Runs of dac, gail and airl keep theirs. Beside it stands what the same flight would be paid with its actions shuffled.

Example: aerial-il reward runs/reach_dac dataset=datasets/reach episode=3
"""

from pathlib import Path

from aerial_il.workflows.reward import Reward, reward

SETTINGS, BARE = Reward, ("run",)


def run(settings: Reward) -> None:
    """Draw, and say where."""
    from aerial_il.core.files import write_atomic
    from aerial_il.core.places import claim_file
    from aerial_il.presentation.svg import reward_lines

    uid, paid = reward(settings)
    figure = write_atomic(claim_file(settings.out or Path(settings.run) / "reward.svg"), reward_lines({uid: paid}))
    means = ", ".join(f"{label} {values.mean():.3f}" for label, values in paid.items())
    print(f"Mean reward: {means}\nFigure: {figure}")
