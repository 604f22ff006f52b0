"""Curation: see what a dataset holds, choose from it, put datasets together, correct labels, take edits back."""
