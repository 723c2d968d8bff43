"""Self-collision: which nodes come near each other, and what that does."""
