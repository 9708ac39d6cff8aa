"""Pages and sentences about results."""
