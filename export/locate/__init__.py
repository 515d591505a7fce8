"""Finding the display in a photograph."""
