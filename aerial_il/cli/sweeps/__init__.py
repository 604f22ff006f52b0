"""Sweeps: their jobs, where these stand, and what became of them; how jobs are started is said by a launcher."""
