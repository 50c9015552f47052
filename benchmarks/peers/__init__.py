"""The alignment problem of ten states in other filter packages, one file a package. Run by ``benchmarks/peers.py``."""
