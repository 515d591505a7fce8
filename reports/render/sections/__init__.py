"""The report's sections, each from a stored run alone; one that lacks its data says so."""
