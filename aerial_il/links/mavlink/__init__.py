"""MAVLink: the suite as a PX4-style simulator in lockstep, a stand-in autopilot, and an offboard client of either.

No PX4 and no hardware has been run with it: what speaks to the simulator in our tests is the stand-in.
"""
