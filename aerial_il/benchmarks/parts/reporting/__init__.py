"""Reports of benchmarks: rows, targets and figures, and the pages that they become."""
