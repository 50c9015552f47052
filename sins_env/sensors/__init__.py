"""Sensors: what an IMU, a GPS receiver and aiding sensors measure of the true motion.

Exact increments and true states come in with a specification of errors; measured increments and fixes go out. The
Allan deviation goes the other way, from increments to the errors of their sensor. Read ``imu``, ``gps``, ``allan``,
``noise_fit``; then ``limits``, ``aids``, and an aiding sensor, such as ``height``.
"""
