"""Measured signals: reading, resampling, preparation, spectra and correlations."""
