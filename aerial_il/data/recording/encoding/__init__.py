"""Encoding: the values of a step as bytes of ROS 2 messages and images, and back."""
