"""What is compared, where, and how predictions are made, stored and resumed."""
