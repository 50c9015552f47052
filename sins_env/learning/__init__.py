"""Learning: data sets of simulated runs, and an environment whose actions tune a filter's noise.

A task comes in; files with observations, truth and splits go out, or an environment of Gymnasium. The seeds here can never
be those of a suite. Read ``seeds``, ``drawing``, ``dataset``, then its forms ``npz_form`` and ``minari_form``.
"""
