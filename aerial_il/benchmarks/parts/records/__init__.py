"""Results kept on disk by all that decides them, so that nothing is done twice and nothing outdated is used."""
