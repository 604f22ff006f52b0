"""Commands about recorded datasets: what they hold, whether they can be trusted, other formats."""
