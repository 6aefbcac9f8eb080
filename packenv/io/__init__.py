"""Files: catalogues, orders, containers, plans, the viewer page and pictures."""
