"""Predictions to accuracies, intervals and paired comparisons."""
