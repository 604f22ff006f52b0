"""Say which steps of a flight are about which thing, for aerial-il generate: by hand on a page, or by script.

Generation finds such cuts itself; those that are said here count instead. They are kept in the dataset, as the column
cuts; aerial-il undo takes the last ones back. Beside the page, page=false prints the cuts as they stand.

Example: aerial-il segment datasets/one
Example: aerial-il segment datasets/one page=false
Example: aerial-il segment datasets/one cuts=[cube:40-95,bowl:120-204]
Example: aerial-il segment datasets/one cuts=[phases]
Example: aerial-il segment datasets/one cuts=[found]
"""

from aerial_il.cli.greeting import greeting
from aerial_il.workflows.segment import Segmentation, segment

SETTINGS, BARE = Segmentation, ("dataset",)


def run(settings: Segmentation) -> None:
    """Cut, or serve the page until interrupted, and print the cuts."""
    for uid, cuts in segment(settings, greeting("Cut", "; what is saved stays", open_page=settings.open)).items():
        print(f"{uid}: {', '.join(map(str, cuts))}")
