"""Aids: what holds the inertial solution, one file a sensor; a reading becomes a measurement of the error state.

``aid`` says what the pipeline asks of an aid; ``gps`` are the fixes.
"""
