"""LeRobot v3: reading, writing, and what both share."""
