"""Look through thousands of episodes on a page: plot, table, films; mark some, and delete or relabel them.

The page is served to this machine alone; films are made when they are asked for. Edits are those of aerial-il delete,
relabel and undo. out=PAGE.html writes it as a file that opens offline, on which marks become a command to type.

Example: aerial-il browse datasets/pick
Example: aerial-il browse datasets/pick out=pick.html
"""

from aerial_il.cli.greeting import greeting
from aerial_il.workflows.browse import Browse, browse

SETTINGS, BARE = Browse, ("dataset",)


def run(settings: Browse) -> None:
    """Write the page, or serve it until interrupted."""
    if (page := browse(settings, greeting("Look", "", open_page=settings.open))) is not None:
        print(f"Page: {page}")
