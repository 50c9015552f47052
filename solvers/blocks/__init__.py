"""Blocks: the mathematics that at least two filters share, on whole batches of runs.

Beliefs and functions come in, moments and updated beliefs go out; a block knows no filter. Read ``square_root`` and ``moments``
with ``sigma_rules`` first, then ``conditioning``; ``factors``, ``mixtures`` and ``noise`` serve one kind of filter each.
"""
