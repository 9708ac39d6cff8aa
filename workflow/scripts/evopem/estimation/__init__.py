"""Prediction-error estimation of ARMAX models by a global memetic search."""
