"""What every filter does with what it is given: shapes, functions, components that are missing, angles."""

import math

import numpy as np
import pytest
from oracles.problems import look, spd, swing
from oracles.zoo import draws, generators, is_batched, settings_of, zoo

from solvers.filters import make_filter, names
from solvers.types import MISSING, Gaussian, Linear, Measurement, NoiseLaw, Transition

I2, F = np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]])
Q, H, R, z = 0.01 * I2, np.eye(1, 2), np.array([[0.04]]), np.array([0.3])
SETTINGS = {name: settings_of(name) for name in names()}


def after(name, f=None, Q=Q, h=None, R=R, z=z, prior=None, batch=(), dt=None, **told):
    flt = make_filter(name, **SETTINGS[name])
    b = flt.init(prior or Gaussian(np.zeros((*batch, 2)), I2), generators(batch))
    me = Measurement(z, Linear(H) if h is None else h, R, **told)
    b, _ = flt.step(b, Transition(Linear(F) if f is None else f, Q, dt=dt), me)
    return flt.estimate(b)


def in_place(x):
    x[..., 0] += x[..., 1]
    return x


def resets_the_rate(x):
    x[..., 1] = 0.0
    return x[..., :1]


WRONG = [
    ({"Q": np.diag(Q)}, r"Q of shape \(2,\): needed \(2, 2\); variances alone are np.diag\(Q\)"),
    ({"Q": Q[:1]}, r"Q of shape \(1, 2\): needed \(2, 2\)"),
    ({"Q": 0.01}, r"Q of shape \(\): needed \(2, 2\)"),
    ({"Q": np.eye(3)}, r"Q of shape \(3, 3\): needed \(2, 2\)"),
    ({"Q": np.diag([0.01, -0.01])}, "Q is no covariance: .* allowed: symmetric, with variances >= 0"),
    ({"Q": np.array([[1.0, 2.0], [2.0, 1.0]])}, "Q is no covariance"),
    ({"R": -R}, "R is no covariance"),
    ({"R": np.diag([0.04, 0.09])}, r"R of shape \(2, 2\): needed \(1, 1\)"),
    ({"z": np.ones(2)}, r"z of shape \(2,\): needed \(1,\)"),
    ({"z": np.ones((1, 1))}, r"z of shape \(1, 1\): needed \(1,\)"),
    ({"h": Linear(I2), "z": np.ones(2), "R": np.array([0.04, 0.09])}, r"R of shape \(2,\): needed \(2, 2\); variances"),
    ({"h": Linear(I2), "z": np.ones(2)}, r"R of shape \(1, 1\): needed \(2, 2\)"),
    ({"f": Linear(np.ones((3, 2)))}, r"matrix of f of shape \(3, 2\): needed \(2, 2\)"),
    ({"h": Linear(np.ones((1, 3)))}, r"matrix of h of shape \(1, 3\): needed \(m, 2\)"),
    ({"present": [True, False]}, r"present of shape \(2,\): needed \(1,\)"),
    ({"turns": [True, False]}, r"turns of shape \(2,\): needed \(1,\)"),
    ({"z": np.array([0.3j])}, "z is complex: needed real numbers"),
    ({"law": NoiseLaw(share=1.5)}, r"law = NoiseLaw\(share=1.5, .*: needed a share from 0 to 1, a factor > 0"),
    ({"dt": -1.0}, r"dt = -1.0: needed the seconds of the epoch, >= 0"),
    ({"f": F}, r"f is of type ndarray: needed a function, or Linear\(matrix\)"),
    ({"f": lambda x: (x @ F.T) + 0j}, "f is complex: needed real numbers"),
    ({"f": Linear(F + 0j)}, "matrix of f is complex"),
    ({"prior": Gaussian(np.zeros(2) + 0j, np.eye(2))}, "prior mean is complex"),
    ({"prior": Gaussian(np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]]))}, "prior covariance is no covariance"),
    ({"prior": Gaussian(np.zeros(2), np.array([[1.0, 0.5], [0.0, 1.0]]))}, "prior covariance is no covariance"),
]
WRONG_FUNCTIONS = [
    ({"f": lambda x: np.array([x[0] + x[1], x[1]])}, r"f of x \(\d+, 2\) has the shape \(2, 2\): needed \(\d+, 2\)"),
    ({"h": lambda x: x[..., 0]}, r"h of x \(\d+, 2\) has the shape \(\d+,\): needed \(\d+, 1\)"),
]


@pytest.mark.parametrize("name", names())
def test_what_does_not_fit_is_refused(name):
    for given, message in WRONG:
        with pytest.raises(ValueError, match=message):
            after(name, **given)
    if name != "filterpy_ukf":  # it takes a function of one run
        for given, message in WRONG_FUNCTIONS:
            with pytest.raises(ValueError, match=message):
                after(name, **given)
    if not is_batched(name):
        return
    for given, message in (
        ({"R": np.array([[0.04], [0.09]])}, r"R of shape \(2, 1\): needed \(1, 1\) for all runs, or \(2, 1, 1\)"),
        ({"z": np.zeros(2)}, r"z of shape \(2,\): needed \(1,\) for all runs, or \(2, 1\)"),
        ({"z": np.zeros((1, 1))}, r"z of shape \(1, 1\): needed"),
        ({"Q": np.full((3, 2), 0.01)}, r"Q of shape \(3, 2\): needed \(2, 2\) for all runs, or \(2, 2, 2\)"),
        ({"Q": np.stack([Q, -Q])}, r"Q of run \(1,\) is no covariance"),
    ):
        with pytest.raises(ValueError, match=message):
            after(name, batch=(2,), **given)


def of_one_run(x):
    return np.array([x[0] + 0.3 * x[1] + 0.1, np.sin(x[1])])


@pytest.mark.parametrize("name", [n for n in names() if is_batched(n)])
def test_a_function_of_one_run_is_refused_with_n_runs_too(name):
    """Two runs of two states: the shape fits, and the result is that of the transposed states."""
    fits = r"of x \(2(, \d+)*, 2\) gives the first row another result than alone"
    both = {"z": np.ones(2), "R": I2}
    for given in ({"f": of_one_run}, {"h": of_one_run, **both}):
        with pytest.raises(ValueError, match=fits):
            after(name, batch=(2,), **given)


class WithJacobian:
    """A function whose Jacobian is whatever it is given."""

    def __init__(self, slope, both=False):
        self.slope = slope
        if both:
            self.value_and_jacobian = lambda x: (x @ F.T, slope)

    def __call__(self, x):
        return x @ F.T

    def jacobian(self, x):
        return self.slope


@pytest.mark.parametrize("name", ["kf", "ekf", "iekf", "imm_ekf", "mpf_ekf", "hepf", "filterpy_kf", "filterpy_ekf"])
def test_jacobians_are_checked(name):
    right = after(name, f=WithJacobian(F))
    for same in (WithJacobian(F, both=True), WithJacobian(F.tolist()), WithJacobian(F.astype(int))):
        np.testing.assert_array_equal(after(name, f=same).cov, right.cov)
    for wrong in (F[:1], F[0], np.ones((3, 2)), None, 1.0):
        for both in (False, True):
            with pytest.raises(
                ValueError, match=r"Jacobian of f at x \(.*2,?\) has the shape \(.*\): needed \(.*2, 2\)"
            ):
                after(name, f=WithJacobian(wrong, both))


class OfOneRun:
    """A matrix in front of the states, for filters that ask for no points."""

    def __call__(self, x):
        return F @ x

    def jacobian(self, x):
        return F


def test_a_matrix_in_front_is_of_one_run():
    for name in ("ekf", "kf", "iekf"):
        with pytest.raises(ValueError, match="as a function of one run does"):
            after(name, f=OfOneRun(), batch=(2,))
        assert np.isfinite(after("ekf", f=OfOneRun()).mean).all()


def test_other_functions_pass_with_n_runs():
    """Bound to the batch, of runs alone, random; a right one is called three times more, once, and gets its own arrays."""
    M, calls, rng = np.stack([F, 2.0 * F]), [], np.random.default_rng(0)

    def right(x):
        calls.append(x.shape)
        x[..., 0] += x[..., 1]
        return x

    def bound(x):
        return (M @ x[..., None])[..., 0] if x.ndim == 2 else x @ M.mT

    for f in (bound, lambda x: x + rng.standard_normal(x.shape), lambda x: [*np.atleast_2d(x @ F.T)]):
        assert np.isfinite(after("ekf", f=f, batch=(2,)).mean).all()
    for _ in range(2):
        assert np.isfinite(after("ckf", f=right, batch=(2,)).mean).all()
    assert calls.count((2, 4, 2)) == 2 * 2 + 2  # an array that cannot be written to, then a copy
    assert calls.count((2,)) == 1
    np.testing.assert_array_equal(after("ckf", f=right, batch=(2,)).mean[0], after("ckf", f=right).mean)


@pytest.mark.parametrize("name", names())
def test_what_fits_in_one_way_is_converted(name):
    right = after(name)
    nothing = after(
        name, h=Linear(np.zeros((0, 2))), z=np.zeros(0), R=np.zeros((0, 0))
    )  # a fix without components is none
    np.testing.assert_array_equal(nothing.mean, after(name, z=[None]).mean)
    for given in (
        {"R": 0.04, "z": 0.3},
        {"R": np.array([0.04]), "z": [0.3]},
        {"Q": Q.tolist(), "R": R.tolist(), "f": Linear(F.tolist()), "h": Linear(H.tolist())},
        {"prior": Gaussian([0, 0], [[1, 0], [0, 1]])},
    ):
        np.testing.assert_array_equal(after(name, **given).mean, right.mean)
    by_function = after(name, f=lambda x: x @ F.T, h=lambda x: x[..., :1])
    changing = after(name, f=in_place, h=resets_the_rate)  # each call gets an array of its own
    np.testing.assert_array_equal(changing.mean, by_function.mean)
    np.testing.assert_array_equal(changing.cov, by_function.cov)
    one = make_filter(name, **SETTINGS[name])
    b = one.init(Gaussian(np.zeros(1), 4.0), generators(()))
    b, _ = one.step(b, Transition(Linear(np.eye(1)), 0.01), Measurement(1.0, Linear(np.eye(1)), 0.04))
    assert one.estimate(b).mean.shape == (1,)


@pytest.mark.parametrize("name", [n for n in names() if is_batched(n)])
def test_a_batch_of_no_runs(name):
    for f, h in ((None, None), (lambda x: x + 0.1 * np.sin(x), lambda x: np.sin(x[..., :1]))):
        x = after(name, f=f, h=h, z=np.zeros((0, 1)), batch=(0,))
        assert (x.mean.shape, x.cov.shape) == ((0, 2), (0, 2, 2))


@pytest.mark.parametrize(("name", "settings"), list(zoo()))
def test_a_missing_component_is_a_fix_without_it(name, settings):
    """Each run of a batch misses others; alone, each has fixes from which the missing rows are taken out."""
    if name in ("augmented_aukf", "vb_ckf"):
        pytest.skip("it keeps the size of the fix that was told")
    runs, n, steps = 4 if is_batched(name) else 1, 4, 7
    rng = np.random.default_rng(3)
    x, P, R, tr = rng.standard_normal((runs, n)), spd(rng, runs, n), spd(rng, 2), Transition(swing, 0.05 * np.eye(n))
    z, has = 0.5 * rng.standard_normal((steps, runs, 2)), rng.random((steps, runs, 2)) < 0.6
    has[0], own, some = True, generators((runs,)), slice(None) if runs > 1 else 0
    flt = make_filter(name, **settings)
    b = flt.init(Gaussian(x[some], P[some]), own if runs > 1 else own[0])
    each = [flt.init(Gaussian(x[i], P[i]), g) for i, g in enumerate(generators((runs,)))]
    for k in range(steps):
        there, told = has[k][some], {}
        z_k, R_k = np.where(there, z[k][some], np.nan), R
        if k % 3 == 1:
            z_k, told = np.where(there, z[k][some], 7.0), {"present": there}
        elif k % 3 == 2:
            z_k = z[k][some]
            R_k = R + np.where(there, 0.0, MISSING)[..., None] * np.eye(2)
        b, seen = flt.step(b, tr, Measurement(z_k, look, R_k, **told))
        np.testing.assert_array_equal(np.isnan(seen.residual), ~there)
        for i in range(runs):
            rows = np.flatnonzero(has[k, i])
            me = Measurement(z[k, i, rows], lambda v, rows=rows: look(v)[..., rows], R[np.ix_(rows, rows)])
            each[i], alone = flt.step(each[i], tr, me if len(rows) else None)
            if len(rows):
                np.testing.assert_allclose(seen.cov.reshape(-1, 2, 2)[i][np.ix_(rows, rows)], alone.cov, rtol=1e-9)
    for i, one in enumerate(each):
        for together, alone in zip(flt.estimate(b), flt.estimate(one), strict=True):
            np.testing.assert_allclose(np.reshape(together, (-1, *alone.shape))[i], alone, rtol=1e-10, atol=1e-12)


def test_a_matrix_that_its_owner_changes_is_checked_again():
    """The same array, with the variance that marks a missing component, and with a negative one."""
    flt, mine = make_filter("ekf"), np.diag([0.04, 0.09])
    b, tr = flt.init(Gaussian(np.zeros(2), I2)), Transition(Linear(F), Q.copy())
    me = Measurement(np.ma.array([0.3, 7.0], mask=[False, True]), Linear(I2), mine)
    b, seen = flt.step(b, tr, me)
    np.testing.assert_array_equal(np.isnan(seen.residual), [False, True])  # what a mask hides is missing
    b, seen = flt.step(b, tr, me._replace(z=np.array([0.3, 0.1])))
    assert np.isfinite(seen.residual).all()
    mine[0, 0] = MISSING
    b, seen = flt.step(b, tr, me._replace(z=np.array([0.3, 0.1])))
    np.testing.assert_array_equal(np.isnan(seen.residual), [True, False])
    tr.Q[0, 0] = -1.0
    with pytest.raises(ValueError, match="Q is no covariance"):
        flt.step(b, tr, None)


@pytest.mark.parametrize("name", ["aukf", "aukf_fading", "aukf_window", "augmented_aukf", "vb_ckf"])
def test_a_noise_that_is_learnt_keeps_its_size(name):
    flt = make_filter(name, adapt="R")
    b, tr = flt.init(Gaussian(np.zeros(2), I2)), Transition(Linear(F), Q)
    b, _ = flt.step(b, tr, Measurement(np.array([0.3]), Linear(H), R))
    with pytest.raises(
        ValueError, match="z has 2 components, and the noise of 1 has been learnt: needed z, h and R of the same 1"
    ):
        flt.step(b, tr, Measurement(np.ones(2), Linear(I2), 0.04 * I2))
    assert np.isfinite(after(name, h=Linear(I2), z=np.ones(2), R=0.04 * I2).mean).all()


@pytest.mark.parametrize(
    ("name", "settings"), [("aukf", {"project": "diagonal"}), ("aukf", {"project": "full"}), ("vb_ckf", {})]
)
def test_a_noise_that_is_learnt_survives_missing_components(name, settings):
    """Two sensors with independent noise: what one misses must not reach the R of the other."""
    rng, steps = np.random.default_rng(4), 200
    flt = make_filter(name, adapt="R", **settings)
    one = make_filter(name, adapt="R", **settings)
    tr, told = Transition(Linear(0.9 * np.eye(2)), 0.1 * np.eye(2)), 0.25 * np.eye(2)
    b, other = flt.init(Gaussian(np.zeros(2), np.eye(2))), one.init(Gaussian(np.zeros(2), np.eye(2)))
    for k in range(steps):
        fix = rng.standard_normal(2)
        full = Measurement(fix, Linear(np.eye(2)), told)
        b, _ = flt.step(b, tr, full._replace(present=[True, k % 2 == 0 and k != 0]))
        other, _ = one.step(other, tr, full)
    got, alone = flt.diagnostics(b)["R"], one.diagnostics(other)["R"]
    got, alone = (a if a.ndim == 1 else np.diagonal(a) for a in (got, alone))
    np.testing.assert_allclose(got[0], alone[0], rtol=0.02)
    assert 0.5 < got[1] / alone[1] < 2.0  # half as many fixes of the same noise


POLAR = np.diag([4e-4, 0.01])


def polar(x):
    return np.stack([np.arctan2(x[..., 1], x[..., 0]), np.hypot(x[..., 0], x[..., 1])], axis=-1)


@pytest.mark.parametrize(("name", "settings"), list(zoo()))
def test_angles_turn(name, settings):
    """A target due west, with bearings at +-pi, is found as one due east; a heading is counted from any turn."""
    flt, batch = make_filter(name, **settings), (3,) if is_batched(name) else ()
    found = []
    for side in (1.0, -1.0):
        rng = np.random.default_rng(1)
        x = np.array([10.0, 0.05]) + 0.2 * rng.standard_normal((*batch, 2))
        b = flt.init(Gaussian(side * x, 0.04 * I2), generators(batch))
        for _ in range(4):
            v = np.array([0.02, 0.1]) * rng.standard_normal((*batch, 2))
            bearing = np.angle(side * np.exp(1j * v[..., 0]))
            fix = np.stack([bearing, 10.0 + v[..., 1]], axis=-1)
            me = Measurement(fix, polar, POLAR, turns=[True, False])
            b, seen = flt.step(b, Transition(Linear(I2), 0.01 * I2), me)
            assert (np.abs(seen.residual) < 1.0).all() or _at_origin(flt)
        found.append((side * flt.estimate(b).mean, flt.estimate(b).cov))
    if not draws(name) and not _at_origin(flt):
        for east, west in zip(*found, strict=True):
            np.testing.assert_allclose(east, west, rtol=1e-6, atol=1e-7)
    headings = []
    for turns, unwrapped in ((True, -3.12), (True, -3.12 + 6.0 * math.pi), (False, -3.12 + 2.0 * math.pi)):
        b = flt.init(Gaussian(np.array([3.1, 0.0]), np.diag([0.04, 0.01])), generators(()))
        for _ in range(3):
            me = Measurement(np.array([unwrapped]), Linear(H), R, turns=[turns])
            b, _ = flt.step(b, Transition(Linear(F), Q), me)
        headings.append(flt.estimate(b).mean)
    np.testing.assert_allclose(headings[0], headings[1], rtol=1e-7, atol=1e-9)
    chance = 0.1 if draws(name) else 1e-9  # some weigh the marginal of a plain linear fix, but not of an angle
    np.testing.assert_allclose(headings[0], headings[2], rtol=1e-7, atol=chance)


def _at_origin(flt):
    """Whether it takes tangents where there is no bearing."""
    return getattr(flt, "feedback", "") == "closed" and type(flt).__name__ in ("KF", "HinfKF", "FilterpyKF")
