"""How a person does a task by hand: one file each, found by the task's name."""
