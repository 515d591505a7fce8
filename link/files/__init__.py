"""How files and folders are shared with other processes."""
