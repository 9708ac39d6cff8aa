"""Validation of a model: residual tests, prediction, simulation, and checks in words."""
