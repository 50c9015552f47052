"""A setting of the C library's allocator that makes large batches up to twice as fast."""

from __future__ import annotations

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def keep_freed_memory(num_bytes: int = 1 << 28) -> None:
    """Have glibc keep up to ``num_bytes`` of freed memory instead of returning it to the kernel.

    NumPy frees its temporaries at once. Above a threshold glibc returns them, and the next operation pays for new pages.
    With this setting a CKF step of 1024 runs is twice as fast. The whole chain at 256 runs is equally fast, because there
    glibc's own threshold adapts soon. It is for our own processes (workers, command line, benchmarks), and not done on
    import. Another C library is left as it is.
    """
    try:
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_TRIM_THRESHOLD, num_bytes)
        libc.mallopt(_M_MMAP_THRESHOLD, min(num_bytes, 1 << 25))  # glibc refuses more than 32 MiB
    except (OSError, AttributeError, TypeError):
        return
