"""Transitions kept to be learned from again: of demonstrations, of own flights, with other goals."""
