"""Show flights of the experts: side by side in one small animation, WebP, or one after another as a film, MP4.

Each flies the first of a few seeds that it solves. Side by side all play in real time, a few at once, then the next. A
film follows each flight from a camera of its own, with the trails of tool (orange) and base (blue), wind (light blue)
and contact force (red) as arrows. It lasts ``seconds``: flights too long for their share of the time play up to twice
as fast, and if all are short, all play slower, at half speed at most.

Example: aerial-il film out=docs/film.webp
Example: aerial-il film out=film.mp4 size=[1080,1920]
Example: aerial-il film flights=[quad/hover,ua_quad_arm4/reach/gusts] abreast=2 out=two.webp
"""

from aerial_il.workflows.film import Film, film

SETTINGS = Film


def run(settings: Film) -> None:
    """Fly, draw, and say where the animation or the film is."""
    path = film(settings)
    print(f"Film: {path}, {path.stat().st_size / 1000:.0f} kB")
