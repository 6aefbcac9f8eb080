"""Measurements over many orders: resumable, with a row for every job, on any number of workers."""
