"""Numbers as options take them; what is wrong with one is a line."""

from __future__ import annotations

import argparse


def seed(text: str) -> int:
    """A seed as NumPy takes it."""
    value = int(text)
    if not 0 <= value < 2**64:
        raise argparse.ArgumentTypeError(f"{value} is not between 0 and 2^64 - 1")
    return value


def seconds(text: str) -> float:
    """A time of more than 0 s."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not more than 0 seconds")
    return value


def settling(text: str) -> float:
    """A time of more than 0 and at most 600 s."""
    value = float(text)
    if not 0.0 < value <= 600.0:
        raise argparse.ArgumentTypeError(f"{text} is not more than 0 and at most 600 seconds")
    return value


def count(text: str) -> int:
    """A whole number of at least 0."""
    try:
        value = int(text)
    except ValueError:
        value = -1
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of at least 0")
    return value


def at_least_one(text: str) -> int:
    """A whole number of at least 1."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of at least 1")
    return value
