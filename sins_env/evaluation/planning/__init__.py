"""Questions before a trip: how long must I align, how must I move, which sensor limits me?

A task comes in, and the bound of its errors over time goes out. With it come the share of each source of error, the time at
which a wanted accuracy is reached, and what the bound tends to. No run is played.
Read ``quantities``, ``sources``, ``recursion``, ``beyond``, ``curves``, ``tables``, ``figure``, ``forecast``, then ``compute``
and ``family``.
"""
