"""Environments for aerial manipulation: tasks, disturbances, single and batch worlds."""
