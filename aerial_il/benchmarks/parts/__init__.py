"""Parts that the benchmarks share: reports, studies on disk, figures, reference motions, timing."""
