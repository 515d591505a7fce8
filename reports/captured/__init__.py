"""Own recordings become captures: films or photographs of a display, and what it showed."""
