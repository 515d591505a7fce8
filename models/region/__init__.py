"""Where in a film displays toggle: a network that maps the likely places, for the search."""
