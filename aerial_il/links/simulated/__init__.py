"""The link to a robot that is simulated in this process."""
