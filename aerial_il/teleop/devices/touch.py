"""Sticks and buttons drawn on the page: each button gives the command that it is named after."""

from aerial_il.teleop.input.mapping import DIRECTIONS, HELD, PRESSED

CONTROLS = tuple(f"touch:{command}" for command in (*DIRECTIONS, *HELD, *PRESSED))
