"""Stages that learning studies share: demonstrations, trainings, evaluations."""
