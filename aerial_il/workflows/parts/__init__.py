"""Environments, policies and demonstrations as commands name them: opened, flown and reported."""
