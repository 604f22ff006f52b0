"""Commands about the project itself: what there is, whether it works, how good it is."""
