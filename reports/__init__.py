"""Score decoded frames, and write numbers, tables and pictures."""
