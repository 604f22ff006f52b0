"""Seeing for policies of the state: where objects are and how they stand, estimated from a robot's own cameras."""
