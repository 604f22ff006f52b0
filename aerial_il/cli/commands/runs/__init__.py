"""Commands over trainings: make one, look into it, compare several."""
