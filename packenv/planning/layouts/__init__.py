"""Layouts: places of all items at once, free of overlap or on the way to it, and what plans they make."""
