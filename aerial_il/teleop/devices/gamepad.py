"""A gamepad in the standard mapping of the Gamepad API (w3.org/TR/gamepad/#remapping): 17 buttons and 4 axes.

Sticks are axes of the frame, with y down as the API has it; so are the triggers, ``left_trigger`` and
``right_trigger``.
"""

BUTTONS = (
    *("A", "B", "X", "Y", "LB", "RB", "LT", "RT", "Back", "Start", "L3", "R3"),
    *("Up", "Down", "Left", "Right", "Home"),
)
CONTROLS = tuple(f"pad:{button}" for button in BUTTONS)
