"""Particle filters: weighted samples instead of moments, with their proposals and random points."""
