"""Judge a policy: closed-loop rollouts on fixed seeds, metrics, statistics, video and a report that opens offline."""
