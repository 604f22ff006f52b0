"""How good a policy is: closed-loop rollouts on fixed seeds, metrics, statistics."""
