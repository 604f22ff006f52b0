"""A robot over ROS 2: real nodes over the real middleware, in processes of their own."""
