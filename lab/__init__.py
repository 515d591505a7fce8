"""Studies: each answers one question with numbers, and one command runs them all."""
