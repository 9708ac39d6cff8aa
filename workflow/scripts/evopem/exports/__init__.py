"""Models in the forms of other programs: C, and functional mock-up units."""
