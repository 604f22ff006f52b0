"""The look of pictures that people see: lamps, floor, shapes and marks that observations and physics never have."""
