"""What is measured directly, without asking a twin."""
