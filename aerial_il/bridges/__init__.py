"""Faces of our environments that other frameworks look for by name; each file of this folder is one framework's."""
