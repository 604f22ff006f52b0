"""A page to fly on, its server and a browser, as a benchmark needs them."""
