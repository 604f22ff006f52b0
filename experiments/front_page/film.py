"""The film of the front page: an episode flown by keys and recorded on the real page, then the policy that learned.

    python -m experiments.by_hand.fly fly --task pick_place --hands keys --episodes 50 --seed 910000 --out runs/film
    aerial-il train dataset=runs/film/pick_place_keys run=runs/film/clone
    python -m experiments.front_page.film --run runs/film/clone --out docs/front_page.webp

Both parts are screenshots of the page in a real browser, taken while the server flies in real time.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import io
import time
from contextlib import suppress
from pathlib import Path

from PIL import Image, ImageDraw

from aerial_il.presentation.films.overlay import font
from experiments.by_hand.fly import reader_at, served
from tests.teleop.chromium import Tab, browser
from tests.teleop.plans import PLANS

TASK, PAGE, SIZE, FPS, FASTER, LIMIT_S = "pick_place", (1280, 800), (768, 480), 8.0, 1.5, 60.0
Shot = tuple[float, Image.Image]


async def shooting(tab: Tab, shots: list[Shot]) -> None:
    """Take pictures of the page, one after another, until cancelled."""
    while True:
        answer = await tab.call("Page.captureScreenshot", format="jpeg", quality=92)
        shots.append((time.monotonic(), Image.open(io.BytesIO(base64.b64decode(answer["data"]))).convert("RGB")))


async def flown(seed: int, out: Path, run: str | None) -> list[Shot]:
    """Return pictures of one episode: flown by keys, or by the policy of a run."""
    settings, shots = [f"policy={run}"] if run else [], list[Shot]()
    async with served(TASK, out, seed, realtime=True, settings=settings) as url, browser() as opened:
        tab = await opened(url)
        await tab.look(width=PAGE[0], height=PAGE[1])
        person = await reader_at(tab, "keys")
        await person.record()
        if run:
            await tab.tap("KeyN")  # nobody needs the numbers
        camera = asyncio.create_task(shooting(tab, shots))
        try:
            if run:
                await person.until(lambda sight: bool(sight.verdict))
            elif not await person.fly(PLANS[TASK](), LIMIT_S):
                raise SystemExit(f"seed {seed} was not solved: choose another one")
            await asyncio.sleep(0.8)
        finally:
            camera.cancel()
            with suppress(asyncio.CancelledError):
                await camera
    return shots


def frames(shots: list[Shot], caption: str) -> list[Image.Image]:
    """Return pictures at an even rate, smaller, with a caption."""
    start, end = shots[0][0], shots[-1][0]
    wanted = [start + k * FASTER / FPS for k in range(int((end - start) * FPS / FASTER) + 1)]
    chosen = [min(shots, key=lambda shot, moment=moment: abs(shot[0] - moment))[1] for moment in wanted]
    return [captioned(picture.resize(SIZE, Image.Resampling.LANCZOS), caption) for picture in chosen]


def captioned(picture: Image.Image, caption: str) -> Image.Image:
    """Write what is seen below the picture."""
    whole = Image.new("RGB", (SIZE[0], SIZE[1] + 34), (13, 17, 23))
    whole.paste(picture, (0, 0))
    ImageDraw.Draw(whole).text((SIZE[0] // 2, SIZE[1] + 17), caption, font=font(18), fill=(236, 240, 244), anchor="mm")
    return whole


def main() -> None:
    """Read the command line and write the film."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", required=True)
    parser.add_argument("--demonstrations", type=int, default=50)
    parser.add_argument("--seed", type=int, default=910_003)
    parser.add_argument("--unseen", type=int, default=920_001)
    parser.add_argument("--scratch", type=Path, default=Path("runs/film/scratch"))
    parser.add_argument("--out", type=Path, default=Path("docs/front_page.webp"))
    parser.add_argument("--quality", type=int, default=30)
    args = parser.parse_args()
    by_keys = frames(asyncio.run(flown(args.seed, args.scratch / "keys", None)), "1  Flown by keys, and recorded")
    learned = f"2  The policy that learned from {args.demonstrations} such flights, on a seed that it has not seen"
    policy = frames(asyncio.run(flown(args.unseen, args.scratch / "policy", args.run)), learned)
    pictures = [*by_keys, *([by_keys[-1]] * 6), *policy, *([policy[-1]] * 10)]
    pictures[0].save(
        args.out, save_all=True, append_images=pictures[1:], duration=int(1000 / FPS), loop=0, quality=args.quality,
        method=6,
    )  # fmt: skip
    print(f"{args.out}: {len(pictures)} pictures, {args.out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
