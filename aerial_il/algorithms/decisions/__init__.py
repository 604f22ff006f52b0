"""On-policy learning that begins with a good policy, and whose decisions last several steps."""
