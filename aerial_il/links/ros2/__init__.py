"""Robots over ROS 2: standard messages under a namespace, between a simulator or a real robot and whoever flies it."""
