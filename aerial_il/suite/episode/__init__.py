"""An episode of n worlds: how it starts, is disturbed, flown, seen and assessed."""
