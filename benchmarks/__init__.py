"""Speed figures, printed as JSON: medians of CPU-seconds on one thread, and ratios inside one run."""
