"""Made-up evaluations."""

from aerial_il.evaluation.metrics import EpisodeRecord
from aerial_il.evaluation.result import EvaluationResult


def result_with(episodes: int, successes: int) -> EvaluationResult:
    """Return an evaluation of ``reach`` whose first episodes succeeded."""
    records = [
        EpisodeRecord(
            seed=seed,
            end="success" if seed < successes else "timeout",
            steps=100,
            duration_s=2.0,
            time_to_success_s=2.0 if seed < successes else None,
            return_=1.0,
            mean_reward=0.5,
            ee_error_mean_m=None,
            ee_error_max_m=None,
            effort_mean=0.3,
            action_jerk_rms={},
            contact_events=0,
            contact_time_s=0.0,
            subtasks={},
        )
        for seed in range(episodes)
    ]
    return EvaluationResult("fa_hexa_arm4", "reach", "calm", "mlp", tuple(records), {"wall_time_s": 1.0})
