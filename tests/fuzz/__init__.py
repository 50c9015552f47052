"""Inputs of strangers, drawn by hypothesis: each is refused in one clear line, or works and gives finite numbers.

``pytest tests/fuzz`` tries a few of each kind; ``FUZZ=10`` tries ten times as many. ``make fuzz N=100000`` tries that many on
all cores and prints a table.
"""
