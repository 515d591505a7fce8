"""What a message does to the light of a display over time, and whether an eye sees it."""
