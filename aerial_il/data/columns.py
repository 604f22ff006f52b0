"""Names of the columns that the table of every dataset has."""

MADE_BY = ("task", "tier", "controller", "policy", "settings", "engine")  # how an episode was made, its seed apart
LABELS = ("operator", "instruction", "tag")  # what people say of it
COLUMNS = ("uid", *MADE_BY, *LABELS, "seed", "steps", "seconds", "success", "failure", "phase", "return")
