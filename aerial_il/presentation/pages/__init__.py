"""Pages that open offline: reports, a flight's page, the gallery, and the docs of robots and tasks."""
