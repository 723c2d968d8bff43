"""The object's surface: its shape at rest, how it is tracked and found again, and how far to trust it."""
