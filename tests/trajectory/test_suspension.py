"""Closed-form responses against scipy's ODE solver, which knows the equation of motion and the shape of the input alone."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from sins_env.trajectory.suspension import Input, Modes, blow, burst, step

HZ, DAMPING = (2.2, 5.2), (0.06, 0.3)
SIZE = np.array([2.0, -0.5])


def response(modes, t, *rows):
    """(rows, times, derivatives, modes)."""
    return modes.response(t, *rows).transpose(2, 3, 0, 1)


def ramp(s):
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(s, 0.0, 1.0))


def bump(s):
    return np.where((s > 0) & (s < 1), 0.5 - 0.5 * np.cos(2 * np.pi * s), 0.0)


#: begin, length, shape, u of the time since the beginning
CASES = {
    "step": (0.7, 0.5, step(0.5), lambda t: ramp(t / 0.5)),
    "blow": (0.7, 0.06, blow(0.06), lambda t: bump(t / 0.06)),
    "burst": (0.2, 2.5, burst(2.5, 2.1), lambda t: bump(t / 2.5) * np.sin(2 * np.pi * 2.1 * t)),
}


def solved(t, pieces, forced):
    """q, q', q'' of one mode at times t by DOP853 at 1e-12, restarted where an input begins or ends."""
    w, zeta, u = forced

    def f(time, x):
        return [x[1], w**2 * (u(time) - x[0]) - 2 * zeta * w * x[1]]

    out, x = [], np.zeros(2)
    for begin, end in itertools.pairwise(pieces):
        inside = t[(t >= begin) & (t < end)]
        found = solve_ivp(f, (begin, end), x, "DOP853", t_eval=np.append(inside, end), rtol=1e-12, atol=1e-14)
        x = found.y[:, -1]
        out.append([[*y, f(time, y)[1]] for time, y in zip(inside, found.y.T, strict=False)])
    return np.concatenate([one for one in out if one])


@pytest.mark.parametrize("case", CASES)
def test_response_is_that_of_the_equation_of_motion(case):
    begin, length, shape, u = CASES[case]
    modes = Modes(HZ, DAMPING)
    modes.drive([[Input(begin, length, shape, SIZE)]])
    t = np.linspace(0.0, 6.0, 301)  # over the edge of a span, and long after the end
    found = response(modes, t)[0]
    for j, (hz, damping, size) in enumerate(zip(HZ, DAMPING, SIZE, strict=True)):
        wanted = solved(
            t, [0.0, begin, begin + length, 6.1], (2 * np.pi * hz, damping, lambda s, a=size: a * u(s - begin))
        )
        scale = np.abs(wanted).max(axis=0)
        assert_allclose(found[:, :, j] / scale, wanted / scale, rtol=0, atol=1e-9)


def test_responses_add_and_begin_anew_in_every_chunk():
    inputs = [Input(b, length, shape, SIZE) for b, length, shape, _ in CASES.values()]
    modes, each = Modes(HZ, DAMPING), Modes(HZ, DAMPING)
    modes.drive([inputs, [], inputs[:1]])
    each.drive([[one] for one in inputs])
    t = np.arange(0.005, 12.0, 0.01)
    found = response(modes, t)
    assert_allclose(found[0], response(each, t).sum(axis=0), atol=1e-12)
    assert_array_equal(found[1], 0.0)
    assert_array_equal(response(modes, t, slice(2, 3)), found[2:])
    parts = [response(modes, part) for part in np.split(t, [3, 50, 71, 600, 601])]
    scale = np.abs(found).max(axis=(0, 1))
    assert_allclose(np.concatenate(parts, axis=1) / scale, found / scale, rtol=0, atol=1e-13)


def test_a_load_settles_at_its_deflection_and_a_blow_leaves_its_impulse():
    modes = Modes(HZ, DAMPING)
    modes.drive([[Input(1.0, 0.5, step(0.5), SIZE)], [Input(1.0, 1e-4, blow(1e-4), SIZE)]])
    assert_allclose(response(modes, np.array([300.0]))[0, 0], [SIZE, [0, 0], [0, 0]], atol=1e-12)
    rate = response(modes, np.array([1.0 + 1e-4]))[1, 0, 1]
    assert_allclose(rate, (2 * np.pi * np.array(HZ)) ** 2 * SIZE * 0.5e-4, rtol=1e-2)
