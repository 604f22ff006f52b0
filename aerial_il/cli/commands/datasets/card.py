"""Write a page about a dataset that opens offline: counts, coverage, suspects with films, provenance, how to load it.

Of a LeRobot dataset it writes the README, too, by which the Hugging Face Hub shows it; readme=PATH does so of any.
Verdicts are those that aerial-il judge has kept, or are made for the page.

Example: aerial-il card datasets/pick
Example: aerial-il card datasets/pick out=pick.html films=0
Example: aerial-il card datasets/pick readme=README.md license=cc-by-4.0
"""

from aerial_il.workflows.card import Card, card

SETTINGS, BARE = Card, ("path",)


def run(settings: Card) -> None:
    """Write the card, and say where it is."""
    made = card(settings)
    print(f"Page: {made.page}")
    if made.readme:
        print(f"README: {made.readme}")
    if made.note:
        print(made.note)
