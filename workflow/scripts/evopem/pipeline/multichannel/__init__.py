"""The stages of a data set with several channels, each in a module of its own."""
