"""The paper's four methods, one file each; numpy and scikit-learn."""
