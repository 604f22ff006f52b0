"""Parts of a range of seeds, each a job that records into the same folder."""

FOLDER = ".shards"  # below the dataset: logs of the jobs that recorded it

Shard = tuple[tuple[str, ...], str]


def shards_of(out: str, seeds: range, shard: int, *, words: tuple[str, ...] = ()) -> list[Shard]:
    """Return, for each part of the seeds, the words that choose it and a folder for its log.

    Args:
        out: the dataset. shard: seeds of a part. words: that each part is given, too.
    """
    parts = (seeds[first : first + shard] for first in range(0, len(seeds), shard))
    return [((f"seed={part[0]}", f"episodes={len(part)}", *words), f"{out}/{FOLDER}/seed={part[0]}") for part in parts]
