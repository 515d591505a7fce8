"""Single parts, measured alone; constants, fitted; and all that needs private data."""
