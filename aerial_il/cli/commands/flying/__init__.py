"""Commands by which something flies: an expert, a policy, a person; recorded, judged or watched."""
