"""Experience replay: transitions of demonstrations, of own flights, and relabelled with other goals."""
