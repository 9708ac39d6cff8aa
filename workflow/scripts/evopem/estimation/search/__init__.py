"""The global search over the parameters of one model."""
