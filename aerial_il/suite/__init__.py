"""The environments: tasks, disturbances, sensors; one world or many, stepped together."""
