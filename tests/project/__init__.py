"""Tests of the house: layers, configuration against registries, set-up."""
