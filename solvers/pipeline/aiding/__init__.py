"""Aids: the sensors that hold the inertial solution, one file per sensor.

A reading comes in, and a measurement of the errors of the INS goes out. Read ``aid`` first, which says what the pipeline asks
of an aid, then ``gps``, the fixes, and ``height``, the simplest of the others. ``together`` makes one measurement of all.
"""
