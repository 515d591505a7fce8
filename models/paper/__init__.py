"""The paper's four methods and `blind`, one file each, and what they share, without torch."""
