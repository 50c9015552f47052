"""Layouts of error states: selection by name, which further blocks do not disturb."""

import numpy as np
import pytest

from sins_env.prior import matched_prior
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.states import ERRORS, FIX, Block, Layout, answered
from sins_env.units import DEG, DEG_PER_H, UG

SHORT = Layout((Block("dv", 2, "m/s"), Block("phi", 3, "rad"), Block("gyro_bias", 3, "deg/h", DEG_PER_H)))


def test_the_errors_of_an_ins_are_those_of_the_documentation():
    """docs/mathematics/frames.md#state-layout."""
    slices = {name: (ERRORS[name].start, ERRORS[name].stop) for name in ERRORS.names}
    assert slices == {"phi": (0, 3), "dv": (3, 6), "dp": (6, 9), "gyro_bias": (9, 12), "accel_bias": (12, 15)}
    assert [block.unit for block in ERRORS.blocks] == ["rad", "m/s", "m", "rad/s", "m/s^2"]
    assert (FIX.names, answered(False).names, answered(True).names) == (("dv", "dp"), ("phi",), ("phi", "dv", "dp"))


def test_further_blocks_move_none():
    more = SHORT.plus(Block("odometer.scale", 1, "1e-3", 1e-3), Block("clock", 2, "m"))
    assert {name: more[name] for name in SHORT.names} == {name: SHORT[name] for name in SHORT.names}
    assert (more["odometer.scale"], more["clock"], more.size) == (slice(8, 9), slice(9, 11), 11)
    np.testing.assert_array_equal(ERRORS.places(SHORT), ERRORS.places(more.only(*SHORT.names)))
    np.testing.assert_array_equal(more.si, [1, 1, 1, 1, 1, DEG_PER_H, DEG_PER_H, DEG_PER_H, 1e-3, 1, 1])
    assert "clock" in more
    assert "clock" not in SHORT


def test_parts_of_a_layout():
    assert ERRORS.span("dv", "dp", "gyro_bias") == slice(3, 12)
    assert ERRORS.without("dp").names == ("phi", "dv", "gyro_bias", "accel_bias")
    assert ERRORS.only("dp", "phi")["phi"] == slice(3, 6)
    np.testing.assert_array_equal(ERRORS.places(SHORT), [3, 4, 0, 1, 2, 9, 10, 11])
    np.testing.assert_array_equal(SHORT.values({"phi": (1.0, 2.0, 3.0), "dv": 5.0}), [5, 5, 1, 2, 3, 0, 0, 0])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: ERRORS["gyro_bais"], "did you mean 'gyro_bias'"),
        (lambda: ERRORS.only("vel"), "unknown block of states 'vel'"),
        (lambda: ERRORS.values({"vel": 1.0}), "unknown block of states 'vel'"),
        (lambda: ERRORS.span("phi", "dp"), "span of phi, dp; allowed: neighbours among phi, dv, dp"),
        (lambda: ERRORS.span("dv", "phi"), "allowed: neighbours"),
        (lambda: ERRORS.plus(Block("dv", 1, "m/s")), "allowed: one block named 'dv'"),
        (lambda: SHORT.places(ERRORS.only("dv")), "block 'dv' of 3 states; allowed: at most 2"),
    ],
)
def test_wrong_names(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()


def test_the_prior_tells_each_block_in_its_place():
    imu = ImuSpec(gyro_bias_deg_h=0.02, accel_bias_ug=100, arw_deg_sqrt_h=0.01, vrw_ug_sqrt_hz=5)
    prior = matched_prior(imu, GpsSpec(vel_std_mps=(0.1, 0.2, 0.3), pos_std_m=(4.0, 5.0, 6.0)), 0.5, (1, 2, 15))
    std = {"phi": (DEG, 2 * DEG, 15 * DEG), "dv": 0.2, "dp": 6.0, "gyro_bias": 0.02 * DEG_PER_H, "accel_bias": 100 * UG}
    np.testing.assert_allclose(prior.P0, np.diag(ERRORS.values(std) ** 2))
    noise = {"phi": 0.01 * DEG / 60, "dv": 5 * UG}
    np.testing.assert_allclose(prior.Q, np.diag(ERRORS.values(noise) ** 2) * 0.5)
    np.testing.assert_allclose(np.sqrt(np.diagonal(prior.R)), FIX.values({"dv": (0.1, 0.2, 0.3), "dp": (4, 5, 6)}))
