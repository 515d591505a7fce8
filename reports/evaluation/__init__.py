"""What evaluate.py measures beside the predictions."""
