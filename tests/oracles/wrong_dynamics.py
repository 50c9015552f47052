"""Error dynamics that are wrong on purpose: the tests of the bound must tell each from the truth.

Each takes the error model and a part of the truth, and gives the part to be linearised.
"""

import dataclasses

import numpy as np

from sins_env import earth


def body_is_level(model, part):
    """Biases that are constant in n."""
    return part._replace(C=np.broadcast_to(np.eye(3), part.C.shape))


def no_acceleration(model, part):
    return part._replace(force=part.force * [0, 0, 1])


def rate_reversed(model, part):
    model.earth = dataclasses.replace(model.earth, rate=-earth.EARTHS["wgs84"].rate)
    return part
