"""The sender: pictures and a message to what a display shows."""
