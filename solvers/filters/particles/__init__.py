"""Particle filters: weighted samples instead of moments, with their proposals and random points.

Gaussian particle filters: read ``gaussian_particles``, then ``gpf`` and ``cgpf``. Filters whose belief is a cloud of particles:
read ``particle_filter``, then ``pf`` and ``upf``. Both kinds use ``planes``, ``importance`` and ``random_points``.
"""
