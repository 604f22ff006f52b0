"""Time steps of the simulation."""

SUBSTEPS = 5  # physics steps in a control step
PHYSICS_DT_S = 0.004
CONTROL_DT_S = PHYSICS_DT_S * SUBSTEPS
