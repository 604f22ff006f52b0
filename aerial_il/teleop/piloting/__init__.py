"""Piloting: from what a device shows at one tick to an action, and who flies."""
