"""On-policy learning that starts from a good policy, and whose decisions last several steps."""
