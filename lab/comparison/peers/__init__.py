"""The field's other systems on the same pictures and channel: python -m lab.comparison.peers."""
