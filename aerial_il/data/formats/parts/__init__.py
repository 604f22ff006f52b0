"""What the files of formats stand on, and a subpackage for a format of several files."""
