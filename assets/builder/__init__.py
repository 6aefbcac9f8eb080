"""Solids, recipes and writers that build the catalogue of household items."""
