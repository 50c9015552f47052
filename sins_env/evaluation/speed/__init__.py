"""What a step costs: seconds of estimator and environment per epoch, beside ckf, and the speed of the whole chain.

Read ``timing``, ``cost``, ``bench``.
"""
