"""What estimators of objects are trained on: frames of flights with what was to be seen in them."""
