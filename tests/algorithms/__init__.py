"""Tests of learning algorithms."""
