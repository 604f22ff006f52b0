"""Write a folder ready for a hub: the successes as a LeRobot dataset, a README, and a page about them.

Only repo=NAME/SET pushes it to the Hugging Face Hub, with the token of the environment variable HF_TOKEN, into a
repository that is private unless private=false says otherwise. The data carry who flew: look at the page first.

Example: aerial-il publish datasets/pick out=hub/pick license=cc-by-4.0
Example: aerial-il publish datasets/pick out=hub/pick license=cc-by-4.0 repo=ana/pick
"""

from aerial_il.workflows.publish import Publish, publish

SETTINGS, BARE = Publish, ("dataset",)


def run(settings: Publish) -> None:
    """Publish, and say where it is."""
    made = publish(settings)
    print(f"LeRobot dataset: {made.folder}\nPage: {made.page}")
    if made.note:
        print(made.note)
    if made.address:
        print(f"Pushed: {made.address}")
