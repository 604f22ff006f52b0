"""Parts that robots share: rotorcraft bases, arms, grippers."""
