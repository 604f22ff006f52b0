"""A model of a person at the sticks: sees what the page shows, late and not quite right, and moves sticks like a hand.

It stands in for people in studies of human-like demonstrations and of taking over. It gets :class:`Status`, which
is what the page gets, and nothing else: no simulator, no observation, no expert. What it does reaches the vehicle as
frames of a device, through mapping, shaping, assist and targets, as a person's does.
"""
