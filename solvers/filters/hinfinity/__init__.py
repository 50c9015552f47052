"""H-infinity filters: they bound the worst case instead of the mean square error.

Read ``hinf`` first, then ``inflation``, its one formula. The other two files are its information form and its mixture
with the UKF.
"""
