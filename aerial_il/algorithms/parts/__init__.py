"""What algorithms share: training data, run folders, optimisation, signals."""
