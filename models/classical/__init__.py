"""The paper's four methods and `blind`, one file each, with what they share; numpy and scikit-learn."""
