"""Pictures: what each camera must show, whichever renderer draws it."""
