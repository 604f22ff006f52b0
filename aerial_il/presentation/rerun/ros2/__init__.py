"""Flights for the tools of ROS 2: the robot as URDF, all frames, pictures and signals as standard messages."""
