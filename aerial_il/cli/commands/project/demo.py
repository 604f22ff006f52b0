"""Go the whole path once: fly, record, convert, learn, evaluate, report. Interrupted, the same command continues.

Each stage is announced as the command that does it alone; a finished stage is not done again.

Example: aerial-il demo
Example: aerial-il demo robot=fa_hexa_arm4 task=reach episodes=50 out=runs/demo_reach
"""

import time

from aerial_il.workflows.demo import Demo, stages

SETTINGS, OUTPUT = Demo, "out"


def run(settings: Demo) -> None:
    """Run every stage that is not finished, then say where everything lies and how well the policy flies."""
    from aerial_il.evaluation.result import load_result

    out, started = settings.out, time.perf_counter()
    for stage in stages(settings):
        print(f"\n{stage.title}\n  {stage.command}", flush=True)
        print(stage.do())
    print(f"\nDone in {time.perf_counter() - started:.0f} s.")
    print(f"  demonstrations  {out}/dataset/demos (MCAP), {out}/dataset/derived/lerobot (LeRobot)")
    print(f"  policy          {out}/training/policy")
    print(f"  report          {out}/evaluation/report.html")
    print(f"  success         {load_result(f'{out}/evaluation').headline()}, on seeds that the policy has never seen")
