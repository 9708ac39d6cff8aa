"""Prediction-error estimates of state-space models with several inputs and outputs."""
