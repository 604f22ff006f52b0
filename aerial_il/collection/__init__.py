"""Demonstrations: from an expert, a policy or a person to episodes on disk."""
