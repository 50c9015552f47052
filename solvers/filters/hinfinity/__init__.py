"""H-infinity filters: they bound the worst case instead of the mean square."""
