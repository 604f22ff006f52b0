"""A keyboard, by the places of its keys (``KeyboardEvent.code``), so that W A S D lie together on every layout."""

from string import ascii_uppercase

LETTERS = tuple(f"Key{letter}" for letter in ascii_uppercase)
ARROWS = ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown")
OTHERS = ("Space", "Enter", "Backspace", "Tab", "ShiftLeft", "ShiftRight", "Escape", "Slash", "Comma", "Period")
CONTROLS = (*LETTERS, *(f"Digit{i}" for i in range(10)), *ARROWS, *OTHERS)  # never Ctrl or Alt: Ctrl+W closes the tab
