"""Spectral estimates: multitaper density, peaks and the empirical frequency response."""
