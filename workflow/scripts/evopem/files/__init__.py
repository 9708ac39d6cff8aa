"""Files of a job: atomic writing, checksums, and the log and errors of the job itself."""
