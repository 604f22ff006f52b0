"""Build the documentation: guides, reference, robots, tasks and studies as one site that opens offline.

The pages of robots and tasks are written into the repository, where they are read too; the site is written anew from
all its pages. A second build takes only what has changed.

Example: aerial-il docs open=true
Example: aerial-il docs site=null films=true
"""

from pathlib import Path

from aerial_il.workflows.docs import Docs, pages, site

SETTINGS = Docs


def run(settings: Docs) -> None:
    """Write what is asked for and say where."""
    from aerial_il.cli import reference

    if settings.site and not Path(settings.site).exists():
        print("Building the site takes about 30 s of processor time, the next time 10.", flush=True)
    for path in pages(settings):
        print(path)
    start = site(settings, reference.pages() if settings.site else {})
    if start is not None:
        print(f"Site: {start}")
        if settings.open:
            show(start)


def show(start: Path) -> None:
    """Open the first page where there is a screen; elsewhere say how to look at it from another machine."""
    import webbrowser

    from aerial_il.presentation.films.window import has_screen

    if has_screen() and webbrowser.open(start.as_uri()):
        return
    print(f"No browser here. Serve it: python -m http.server -b 127.0.0.1 -d {start.parent} 8080")
    print("and from your machine: ssh -N -L 8080:127.0.0.1:8080 THIS_MACHINE, then http://127.0.0.1:8080")
