"""What is done to the samples before anything is estimated, decided from the estimation samples."""
