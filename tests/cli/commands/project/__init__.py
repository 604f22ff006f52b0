"""Commands over the project itself."""
