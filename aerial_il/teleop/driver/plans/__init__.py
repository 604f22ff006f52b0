"""How a person does a task by hand: one file each, named after the task's name."""
