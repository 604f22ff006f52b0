"""What all share: rotations, specifications, seeding, errors, files, the registry. Imports nothing above it."""
