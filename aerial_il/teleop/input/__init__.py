"""Input: what devices show, how it arrives, and what each key or stick means."""
