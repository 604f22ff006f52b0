"""Links: how policies and people's own scripts fly robots that are not stepped by them, simulated or real."""
