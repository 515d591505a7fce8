"""A run of evaluate.py: its findings, pictures, responses and times, and the page of them all."""
