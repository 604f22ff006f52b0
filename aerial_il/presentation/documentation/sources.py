"""Sources of the site: the repository's own pages and pictures, and pages made from the code."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath

from aerial_il.core.errors import AerialError
from aerial_il.presentation.documentation.links import moved, with_films

ROOT = Path(__file__).resolve().parents[3]
PICTURES = (".svg", ".png", ".webp")
FILMS = (".mp4", ".jpg")  # with the picture that each begins with; Sphinx copies them as they are
PAGES, COPIED, TITLES = "source", "copied", "titles.json"
START, FOLDER_PAGE, FRONT = "index.md", "README.md", "README.md"
HEADING = re.compile(r"(?:^|[\"\n])# ([^\n\\\"]+)")
LISTED = re.compile(r"\]\(([\w./-]+\.md)\)")
MADE = {  # heading of the start page -> pages in its list that no link below it leads to
    "Notebooks": ("notebooks/*.ipynb",),
    "Reference": ("commands/index.md", "python/index.md", "spaces/index.md"),
    "Studies": ("experiments/*/index.md",),
    "Project": ("contributing.md", "changelog.md"),
}


class NoSourcesError(AerialError):
    """A site cannot be built where the pages of the repository are not."""


def assemble(folder: Path, generated: Mapping[str, str | bytes], root: Path = ROOT) -> bool:
    """Lay out the pages of a site; what is as it was keeps its time stamp, so that a second build is quick.

    Returns:
        Whether there are other pages or titles than before.

    Args:
        folder: gets ``source``, pages and their pictures, and ``copied``, files that need no work; nothing else stays.
        generated: path on the site -> text or picture that no file of the repository holds.
        root: the repository.

    Raises:
        NoSourcesError: ``root`` holds no pages, as where the package was installed from a wheel.
    """
    places = dict(site_files(root))
    led = {**places, FRONT: START}
    contents = dict(generated)
    for source, place in places.items():
        contents[place] = _content(root / source, source, led)
    for name in [name for name in contents if name.endswith(("/index.md", "/index.rst"))]:
        contents[name] = _with_siblings(name, str(contents[name]), contents)
    contents[START] = with_contents(str(contents[START]), contents)
    for name, content in contents.items():
        place = folder / (COPIED if name.endswith((*FILMS, ".cff")) else PAGES) / name
        _write(place, content.encode() if isinstance(content, str) else content)
    _remove_others(folder, contents)
    return _write(folder / TITLES, json.dumps(_titles(contents)).encode())


def _content(file: Path, source: str, places: Mapping[str, str]) -> str | bytes:
    """Return a file as it stands on the site: links of Markdown, and of a notebook's Markdown, lead to their places."""
    if file.suffix == ".md":
        return with_films(moved(file.read_text(encoding="utf-8"), source, places))
    if file.suffix != ".ipynb":
        return file.read_bytes()
    notebook = json.loads(file.read_text(encoding="utf-8"))
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = moved("".join(cell["source"]), source, places)
    return json.dumps(notebook)


def _remove_others(folder: Path, contents: Mapping[str, object]) -> None:
    for part in (folder / COPIED, folder / PAGES):
        for file in [file for file in part.rglob("*") if file.is_file()]:
            if file.relative_to(part).as_posix() not in contents:
                file.unlink()


def site_files(root: Path = ROOT) -> Iterator[tuple[str, str]]:
    """Yield each page and picture of the repository, and where on the site it goes."""
    if not (root / "docs" / START).exists():
        raise NoSourcesError(
            "The site is built from the pages of a checkout, and this package was installed without them. "
            "Clone the repository and run there: make docs"
        )
    yield "CONTRIBUTING.md", "contributing.md"
    yield "CHANGELOG.md", "changelog.md"
    yield "CITATION.cff", "CITATION.cff"
    for file in sorted((root / "docs").rglob("*")):
        if file.suffix in (".md", *PICTURES, *FILMS):
            yield _name(file, root), _place(file.relative_to(root / "docs"))
    for file in sorted((root / "experiments").glob("*")) + sorted((root / "experiments").glob("*/*")):
        if file.suffix in (".md", *PICTURES):
            yield _name(file, root), _place(file.relative_to(root))
    for file in sorted((root / "notebooks").glob("*.ipynb")) + sorted((root / "notebooks" / "zh").glob("*.ipynb")):
        yield _name(file, root), _name(file, root)


def with_contents(text: str, contents: Mapping[str, str | bytes]) -> str:
    """Return the start page with a list of contents for the margin, under its own headings."""
    groups = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    trees, seen = list[str](), set[str]()
    for group in groups:
        heading = group.partition("\n")[0].strip()
        listed = LISTED.findall(group)
        listed += [name for form in MADE.get(heading, ()) for name in sorted(contents) if fnmatch(name, form)]
        if listed := [name for name in dict.fromkeys(listed) if name not in seen]:
            trees.append(_tree(listed, heading))
            seen |= {*listed}
    return "\n\n".join([text.rstrip(), *trees, ""])


def _with_siblings(page: str, text: str, contents: Mapping[str, str | bytes]) -> str:
    """Return the page of a folder with a list, for the margin, of the other pages there."""
    folder = PurePosixPath(page).parent
    others = [name for name in map(PurePosixPath, sorted(contents)) if name.parent == folder and _is_page(name)]
    listed = [name.name for name in others if name.stem != "index"]
    return f"{text.rstrip()}\n\n{_tree(listed)}\n" if listed else text


def _is_page(name: PurePosixPath) -> bool:
    return name.suffix in (".md", ".rst", ".ipynb")


def _tree(pages: Sequence[str], caption: str = "") -> str:
    options = [":hidden:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["```{toctree}", *options, "", *pages, "```"])


def _place(path: Path) -> str:
    """Return where a page goes; that of a folder becomes the folder's index."""
    return (path.with_name("index.md") if path.name == FOLDER_PAGE else path).as_posix()


def _name(file: Path, root: Path) -> str:
    return file.relative_to(root).as_posix()


def _titles(contents: Mapping[str, str | bytes]) -> dict[str, str]:
    """Return page -> its first heading."""
    pages = [(name, str(text)) for name, text in sorted(contents.items()) if _is_page(PurePosixPath(name))]
    return {name: heading[1] if (heading := HEADING.search(text)) else "" for name, text in pages}


def _write(file: Path, content: bytes) -> bool:
    """Write a file unless it is like that already; return whether it was not."""
    if file.exists() and file.read_bytes() == content:
        return False
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    return True
