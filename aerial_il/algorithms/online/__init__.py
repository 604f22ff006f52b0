"""Learning while flying: the base of these algorithms, their run, its worlds, rewards, demonstrations and buffers."""
