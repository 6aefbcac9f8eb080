"""Short scripts to start from; each ends with a check. Run them from the repository's root."""
