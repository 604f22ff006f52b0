"""What a page of practice from a prior says of how it was measured, and of the arms that are on it."""

from __future__ import annotations

from experiments.common.notes import About, Note
from experiments.common.practised import WATCHED_FLIGHTS
from experiments.common.seeds import TUNING_SEEDS
from experiments.from_prior.practice import LISTED

BEGINNING = "bc, as practice begins"
SLOW, SLOWEST_STEPS = ("dapg", "residual", "jsrl", "ibrl", "rlpd", "ppo"), 30_000
IN_ROUNDS, WATCHED = ("expert_iteration", "filtered_bc"), ("bc_ppo", "residual", "dapg", "jsrl", "ibrl")
NOTES: tuple[Note, ...] = (
    (
        "The reward is sparse: whether a flight succeeded. The final policy of each training is flown in two tiers. "
        "The trainings of an arm differ in their draw: demonstrations and flights (other seeds), weights and "
        "minibatches. Flights: Wilson's 95 % interval over the flights of these very policies. Trainings: Student's "
        "95 % interval with a training as the unit.",
    ),
    (
        "Flown: control steps of practice, mean over trainings. Minutes: of flying and learning, mean over trainings; "
        "the clone that an arm begins with, and its demonstrations, are not included. Practice that goes on from the "
        "policy of other practice (`bench.begun_by`) counts the steps and the minutes of that, too.",
    ),
    (
        About(
            WATCHED,
            "Gains: what {} added to the policies that they began with, on the same flights: won and lost, flights "
            "that only the final policy or only the initial one solves; p, McNemar's exact test over all flights. A "
            "method that begins with a policy that reaches a target already counts there only if its gain is "
            "significant.",
        ),
    ),
    (
        About(
            (BEGINNING,),
            "{}: a clone of the same demonstrations, trained with fields of the observation hidden at random.",
        ),
        About(IN_ROUNDS, "Clones of their own are made by {}."),
    ),
    (
        About(("ppo",), "{} is shown nothing and begins with random weights; it stands for learning from scratch."),
        About(("rlpd",), "{} is shown the demonstrations and begins with random weights."),
        About(
            ("ibrl", "rlpd"),
            "A step of {} takes some three hundred to a thousand times as long as one of bc_ppo; practice stops at "
            f"{SLOWEST_STEPS:,}.",
        ),
        About(
            SLOW,
            "Slow methods have one training run, on the first draw (`bench.fewer`), some of them from some of the "
            "starts (`bench.only_from`).",
        ),
        About(
            ("filtered_bc", "ppo"),
            "No target judges success or dips of {}, flown for comparison.",
        ),
    ),
    (
        "Dip: how far success fell below that of the initial policy after the first 2 % of the steps; the largest over "
        "all draws and times.",
        About(
            WATCHED,
            "Of {} it is that of the policy as it would be handed over, flown without exploration on the tuning seeds "
            f"{TUNING_SEEDS.start} to {TUNING_SEEDS[WATCHED_FLIGHTS - 1]} in the tier it practises in, up to "
            "{watched} times on the way.",
        ),
        About(
            IN_ROUNDS,
            "Of {} it is that of the first attempts of a round, one from each start, before anything was learned from "
            "them.",
        ),
        About(("filtered_bc",), "Those of {} are flown with noise."),
        About(("rlpd", "ppo"), "There is no prior to fall below for {}."),
    ),
    (
        About(
            WATCHED,
            "Exploring dip: of the practice flights themselves, between two rows of the metrics. The first trainings "
            "were judged by it alone, and bc_ppo fell 14.5 points from 40; it was replaced as a measure after that "
            "miss, and is judged now only where no flights were watched: the episodes that end first are the quick "
            "successes, so that the first stretch looks too good (once 82 % against 75 % in the next ones, which the "
            "prior flew as well).",
        ),
        About(("bc_ppo", "residual", "dapg", "ibrl"), "Those of {} have exploration noise."),
        About(("jsrl",), "For {} none can be given, since a guide begins its episodes."),
    ),
    (
        "Figures: in the tier that a task is practised in; a line for each training over an axis of square roots, at "
        "the right the final policies with Wilson's interval over their flights, dashed what is wanted.",
        About(WATCHED, "Lines of {} are the evaluations without exploration that dips are judged by."),
        About(
            IN_ROUNDS,
            "Lines of {} are the first attempts of each round, which are cut off sooner than the final flights "
            "(`patience`).",
        ),
        About(("rlpd", "ppo"), "Faint lines of {} are practice flights, since no others were flown on the way."),
    ),
    (
        "Only in results.json (`details`): success on the way at every evaluation (`on_the_way`), and round by round, "
        f"between two rows of the metrics for what learns step by step (`rounds`; of more than {LISTED} so many, "
        "evenly spread).",
    ),
)
