"""Gates, which decide step by step whether the learner or the expert flies: one file each."""
