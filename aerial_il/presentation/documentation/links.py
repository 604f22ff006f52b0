"""Links between Markdown pages, when the pages move: each keeps leading to the same file."""

import os
import re
from collections.abc import Mapping
from pathlib import PurePosixPath

WORDS = r"(?P<words>[^\]\[]*|!\[[^\]]*\]\([^)]*\))"  # of a link: a text, or a picture
LINK = re.compile(rf"(?P<mark>!?)\[{WORDS}\]\((?P<target>[^)#\s]+)(?P<anchor>#[^)\s]*)?\)")
FILM = re.compile(r"\[!\[([^\]]*)\]\(([^)\s]+)\)\]\(([^)\s]+\.mp4)\)")
BELOW = re.compile(r"^\*Click for the video: (\w)", re.MULTILINE)  # a line below the picture
ELSEWHERE = re.compile(r"[a-z]+:")  # http:, https:, mailto:


def moved(text: str, source: str, places: Mapping[str, str]) -> str:
    """Return a page's text with its relative links led to where their files have gone.

    Args:
        text: Markdown. source: the page's path in the repository.
        places: path in the repository -> path on the site. A link to a file that is not there becomes plain text.
    """

    def replace(match: re.Match[str]) -> str:
        target = match["target"]
        if ELSEWHERE.match(target):
            return match[0]
        file = os.path.normpath(PurePosixPath(source).parent / target)
        words = LINK.sub(replace, match["words"])
        if file not in places:
            return words if "`" in words else f"{words} (`{file}`)"
        return f"{match['mark']}[{words}]({_relative(places[file], places[source])}{match['anchor'] or ''})"

    return LINK.sub(replace, text)


def with_films(text: str) -> str:
    """Return Markdown in which a picture that leads to a film has become the film, which begins with that picture."""
    film = '<video controls muted loop playsinline preload="none" poster="{2}" src="{3}" aria-label="{1}"></video>'
    played = FILM.sub(lambda match: film.format(*match.group(0, 1, 2, 3)), text)
    return BELOW.sub(lambda match: f"*{match[1].upper()}", played)


def _relative(target: str, page: str) -> str:
    return PurePosixPath(os.path.relpath(target, PurePosixPath(page).parent)).as_posix()
