"""Measurements that aid the inertial solution: how a fix becomes an innovation of the error state."""
