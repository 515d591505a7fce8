"""What each switch of the torch decoder is worth, and where: python -m lab ablation."""
