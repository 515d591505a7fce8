"""The sender: a message and pictures become a player, a video or images for a display to show."""
