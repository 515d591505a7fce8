"""A run of evaluate.py: its findings, pictures and times, and the page of them all."""
