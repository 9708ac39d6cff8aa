"""Models of linear systems, and what follows from them."""
