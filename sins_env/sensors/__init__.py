"""Sensors turn true motion into measurements: IMU increments and GPS fixes with their errors; Allan deviation reads errors back.

Read ``imu``, ``gps``, ``allan``.
"""
