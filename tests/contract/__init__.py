"""What every robot, task, tier and action level must keep to; the cases find themselves in the registries."""
