"""Prediction-error estimation of linear models by a global memetic search."""
