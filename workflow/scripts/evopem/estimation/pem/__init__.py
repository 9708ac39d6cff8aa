"""Prediction-error minimisation: objectives, their compiled kernels, and local descents."""
