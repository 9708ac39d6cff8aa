"""The results of a data set: where each file lies, and its contents as typed objects."""
