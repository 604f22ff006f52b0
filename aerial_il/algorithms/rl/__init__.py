"""Machinery of reinforcement learning: collectors, buffers, returns, transitions of demonstrations."""
