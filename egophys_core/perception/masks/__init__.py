"""What in a view is the object, a hand, the table or background."""
