"""Commands about recorded datasets: what they hold, whether they can be trusted, curation, other formats."""
