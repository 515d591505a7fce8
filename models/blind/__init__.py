"""The decoder that needs neither ratex patches nor κ."""
