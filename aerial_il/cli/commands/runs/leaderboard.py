"""Write a page of standings from the records of evaluations: robot, task, tier, method, success, cost of training.

A submission, the folder of a policy or the factory of an installed wheel, is judged in every cell and tier of the board
over seeds that are drawn on the day; its evaluations are kept below the first folder, in submissions/.

Example: aerial-il leaderboard evaluations
Example: aerial-il leaderboard evaluations submission=theirs/policy tiers=[calm,gusts] out=board.html
"""

from aerial_il.workflows.leaderboard import Settings, leaderboard

SETTINGS, BARE = Settings, ("result",)


def run(settings: Settings) -> None:
    """Write the page, print the standings and say where it is."""
    from aerial_il.cli.tables import table

    board, page = leaderboard(settings, told=print)
    rows = [
        {
            "robot": each.robot, "task": each.task, "tier": each.tier, "method": each.method,
            "success": f"{100 * each.rate:.1f} % ({100 * each.ci95.lo:.1f} to {100 * each.ci95.hi:.1f})",
            "trainings": each.trainings, "flights": each.episodes,
        }
        for each in board.standings
    ]  # fmt: skip
    print(table(rows))
    for place, why in board.left_out.items():
        print(f"Not on the board: {place} {why}.")
    print(f"Page: {page}")
