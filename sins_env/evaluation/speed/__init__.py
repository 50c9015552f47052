"""Speed: the cost of a step of an estimator beside that of ckf, and the speed of the whole chain.

A solver and a task come in; seconds of estimator and environment per epoch go out. Read ``timing``, ``cost``, ``bench``.
"""
