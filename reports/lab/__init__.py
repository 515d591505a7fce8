"""What needs private data, or fits constants."""
