"""Ground floor: rotations, specifications, seeding, errors, files. Imports nothing above it."""
