"""From decoded frames to numbers, tables and pictures."""
