"""Machinery of supervised learning: training sets, minibatches, schedules, averaged weights."""
