"""Worlds as MuJoCo and compiled code have them: states, steps, air, sensors, and how one world is read."""
