"""Tests of rollouts, metrics, statistics, video and report."""
