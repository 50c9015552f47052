"""One setting of the C library's allocator, worth a factor of two to four in speed."""

from __future__ import annotations

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def keep_freed_memory(num_bytes: int = 1 << 28) -> None:
    """Have glibc keep up to ``num_bytes`` of freed memory instead of returning it to the kernel.

    NumPy frees its temporaries at once; above 128 KiB glibc hands them back, and the next operation pays for fresh pages:
    2-4 times the cost of the arithmetic at 256 runs. For processes that are ours (workers, command line, benchmarks), not
    done on import. Nothing happens where the C library is another one.
    """
    try:
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_TRIM_THRESHOLD, num_bytes)
        libc.mallopt(_M_MMAP_THRESHOLD, min(num_bytes, 1 << 25))  # glibc refuses more than 32 MiB
    except (OSError, AttributeError, TypeError):
        return
