"""Flight and arm control, usable without the suite: kinematics, dynamics, allocation, observer, whole body."""
