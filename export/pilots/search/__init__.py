"""Look for a display by its pilots: propose where it may be, and settle where it is."""
