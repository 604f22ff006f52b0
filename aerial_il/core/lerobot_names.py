"""Names that lerobot gives the features of a dataset and the inputs and outputs of a policy."""

STATE = "observation.state"  # proprioceptive fields, concatenated
ENVIRONMENT = "observation.environment_state"  # fields of the task, concatenated
IMAGES = "observation.images."  # followed by the name of a camera
ACTION = "action"
