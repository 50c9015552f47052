"""The alignment problem of ten states in other filter packages, with one file per package ``on_...``.

``benchmarks/peers.py`` runs them. Read ``problem`` first, then ``contest``, ``ours`` and ``measuring``; ``tables`` writes the
result.
"""
