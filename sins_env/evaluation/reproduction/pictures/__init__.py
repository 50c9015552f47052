"""Figures of the reproduction paper: error courses, flights and the toy problems."""
