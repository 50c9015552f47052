"""Stamps of instruments: what time they mean, where they wrap, and on which uniform clock their samples lie.

Stamps come in as the file has them. Seconds of one time scale go out (``scales``), which increase (``wraps``), and for the
samples of an IMU their places on a uniform clock, jittered stamps evened out (``places``). ``bridging`` fills short gaps.
"""
