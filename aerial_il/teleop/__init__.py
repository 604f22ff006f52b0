"""A person flies: devices, mapping, flight at 50 Hz, sessions, and a page."""
