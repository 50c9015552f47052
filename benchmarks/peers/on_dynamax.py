"""dynamax: its Kalman, extended, unscented and conditional-moments filters, with a whole record in one compiled scan, and stepped.

The scans correct before they predict, so each starts with the prediction of the first epoch. Stepped, a prediction and a
correction are one compiled call for each fix; dynamax has them as functions of its modules, without a public name.
The conditional-moments filter with the unscented rule at alpha = 1, beta = kappa = 0 is the cubature filter.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.generalized_gaussian_ssm import ParamsGGSSM, UKFIntegrals, conditional_moments_gaussian_filter
from dynamax.generalized_gaussian_ssm import inference as cmgf_parts
from dynamax.linear_gaussian_ssm import inference as lgssm_parts
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params
from dynamax.nonlinear_gaussian_ssm import (
    ParamsNLGSSM,
    UKFHyperParams,
    extended_kalman_filter,
    inference_ekf,
    inference_ukf,
    unscented_kalman_filter,
)

from peers import ours
from peers.contest import UKF, Block, Entry
from peers.plain_map import advance
from peers.problem import Problem
from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Transition

DISTRIBUTION = "dynamax"
KEPT = ["filtered_means", "filtered_covariances"]

One = Callable[..., Any]  #: from problem, predicted mean and covariance, model of each step and fixes to the posterior


def dynamics(x: jax.Array, epoch: jax.Array) -> jax.Array:
    """Return f(x) of an epoch."""
    return jnp.stack(advance(x, epoch, jnp))


def seen(x: jax.Array, epoch: jax.Array) -> jax.Array:
    """Return h(x), the two velocities."""
    return x[:2]


def kf(problem: Problem, mean: jax.Array, cov: jax.Array, F: jax.Array, z: jax.Array) -> Any:
    """Filter one run with the Kalman filter."""
    return lgssm_filter(make_lgssm_params(mean, cov, F, problem.Q, problem.H, problem.R), z)


def ekf(problem: Problem, mean: jax.Array, cov: jax.Array, epochs: jax.Array, z: jax.Array) -> Any:
    """Filter one run with the extended Kalman filter."""
    model = ParamsNLGSSM(mean, cov, dynamics, problem.Q, seen, problem.R)
    return extended_kalman_filter(model, z, inputs=epochs, output_fields=KEPT)


def ukf(problem: Problem, mean: jax.Array, cov: jax.Array, epochs: jax.Array, z: jax.Array) -> Any:
    """Filter one run with the unscented Kalman filter."""
    model = ParamsNLGSSM(mean, cov, dynamics, problem.Q, seen, problem.R)
    return unscented_kalman_filter(model, z, UKFHyperParams(**UKF), inputs=epochs, output_fields=KEPT)


def ckf(problem: Problem, mean: jax.Array, cov: jax.Array, epochs: jax.Array, z: jax.Array) -> Any:
    """Filter one run with the cubature Kalman filter."""
    model = ParamsGGSSM(mean, cov, dynamics, problem.Q, seen, lambda x, epoch: problem.R)
    return conditional_moments_gaussian_filter(model, UKFIntegrals(1.0, 0.0, 0.0), z, inputs=epochs)


def kf_step(problem: Problem, mean: jax.Array, cov: jax.Array, F: jax.Array, z: jax.Array) -> Any:
    """Take one run of the Kalman filter from the posterior of an epoch to that of the next."""
    none = jnp.zeros(1)
    predicted = lgssm_parts._predict(mean, cov, F, jnp.zeros((len(mean), 1)), jnp.zeros_like(mean), problem.Q, none)
    H, R = jnp.asarray(problem.H), jnp.asarray(problem.R)
    return lgssm_parts._condition_on(*predicted, H, jnp.zeros((len(z), 1)), jnp.zeros_like(z), R, none, z)


def ekf_step(problem: Problem, mean: jax.Array, cov: jax.Array, epoch: jax.Array, z: jax.Array) -> Any:
    """Take a step of the extended Kalman filter."""
    predicted = inference_ekf._predict(mean, cov, dynamics, jax.jacfwd(dynamics), problem.Q, epoch)
    return inference_ekf._condition_on(*predicted, seen, jax.jacfwd(seen), problem.R, epoch, z, 1)


def ukf_step(problem: Problem, mean: jax.Array, cov: jax.Array, epoch: jax.Array, z: jax.Array) -> Any:
    """Take a step of the unscented Kalman filter."""
    n = len(mean)
    spread = UKF["alpha"] ** 2 * (n + UKF["kappa"]) - n
    weights = inference_ukf._compute_weights(n, UKF["alpha"], UKF["beta"], spread)
    predicted = inference_ukf._predict(mean, cov, dynamics, problem.Q, spread, *weights, epoch)[:2]
    return inference_ukf._condition_on(*predicted, seen, problem.R, spread, *weights, epoch, z)[1:]


def ckf_step(problem: Problem, mean: jax.Array, cov: jax.Array, epoch: jax.Array, z: jax.Array) -> Any:
    """Take a step of the cubature Kalman filter."""
    rule = UKFIntegrals(1.0, 0.0, 0.0)
    moments = rule.gaussian_expectation, rule.gaussian_cross_covariance
    predicted = cmgf_parts._predict(mean, cov, dynamics, problem.Q, epoch, *moments)[:2]
    fixed = ParamsGGSSM(mean, cov, dynamics, problem.Q, seen, lambda x, epoch: problem.R)
    corrected = cmgf_parts._condition_on(
        *predicted,
        fixed.emission_mean_function,
        fixed.emission_cov_function,
        epoch,
        z,
        *moments,
        1,
        fixed.emission_dist,
    )
    return corrected[1:]


def filter_steps(name: str, problem: Problem, runs: int) -> Block:
    """Make the block of one of the filters with a compiled call for each fix, with ``jax.vmap`` over the runs.

    Nothing is fetched from JAX before the end, which is to its advantage.
    """
    take = partial({"kf": kf_step, "ekf": ekf_step, "ukf": ukf_step, "ckf": ckf_step}[name], problem)
    model = problem.F if name == "kf" else problem.epochs
    alone = runs == 1
    step = jax.jit(take if alone else jax.vmap(take))
    which: Any = 0 if alone else slice(0, runs)
    epochs = list(zip(model[:, which], problem.z[:, which], strict=True))
    shape = () if alone else (runs,)
    prior = [jnp.asarray(np.broadcast_to(a, shape + a.shape)) for a in (problem.mean, problem.P0)]

    def block() -> Gaussian:
        belief: Any = prior
        for steps, z in epochs:
            belief = step(*belief, steps, z)
        return Gaussian(*(np.asarray(a)[None] if alone else np.asarray(a) for a in belief))

    return block


def predicted(name: str, problem: Problem, runs: int) -> Gaussian:
    """Return the prediction of the first epoch by our filter of the same kind: (runs, 10), (runs, 10, 10)."""
    filter = make_filter(name, **ours.SETTINGS[name])
    f = Linear(problem.F[0, :runs]) if name == "kf" else problem.maps(slice(0, runs))[0]
    belief = filter.init(Gaussian(np.zeros((runs, 10)), problem.P0), None)
    return filter.estimate(filter.predict(belief, Transition(f, problem.Q)))


def filter_runs(name: str, problem: Problem, runs: int) -> Block:
    """Make the block of one of the filters, compiled, with ``jax.vmap`` over the runs."""
    filtered = {"kf": kf, "ekf": ekf, "ukf": ukf, "ckf": ckf}[name]
    model = problem.F if name == "kf" else problem.epochs

    def one(mean: jax.Array, cov: jax.Array, steps: jax.Array, z: jax.Array) -> Gaussian:
        posterior = filtered(problem, mean, cov, steps, z)
        return Gaussian(posterior.filtered_means[-1], posterior.filtered_covariances[-1])

    first = predicted(name, problem, runs)
    given = [jnp.asarray(a) for a in (*first, model[:, :runs], problem.z[:, :runs])]
    if runs == 1:
        alone, given = jax.jit(one), [given[0][0], given[1][0], given[2][:, 0], given[3][:, 0]]
        return lambda: Gaussian(*(np.asarray(a)[None] for a in alone(*given)))
    many = jax.jit(jax.vmap(one, in_axes=(0, 0, 1, 1)))
    return lambda: Gaussian(*(np.asarray(a) for a in many(*given)))


REMARK = "which adds 1e-9 to the diagonal of the innovation's covariance"


def entries() -> list[Entry]:
    """Return the filters of the package, fix by fix and with a whole record in one call."""
    ways = ((filter_steps, "a call for each fix", True), (filter_runs, "a scan", False))
    return [
        Entry(
            name.upper(),
            "JAX",
            f"{how}, vmap over runs",
            partial(make, name),
            batched=True,
            compiled=True,
            stepped=stepped,
            remark=REMARK,
        )
        for make, how, stepped in ways
        for name in ours.SETTINGS
    ]
