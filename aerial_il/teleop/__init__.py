"""A person flies: devices, their mapping to commands, the flight at 50 Hz, sessions that record it, and a page."""
