"""Results to tables, charts, pictures and one page."""
