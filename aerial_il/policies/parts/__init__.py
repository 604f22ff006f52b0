"""Parts that policies share: normalisation, chunk execution, the runtime around a network."""
