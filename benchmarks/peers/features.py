"""Features of each package, as data with the evidence. This module needs the standard library only.

The evidence is a file of the package that was looked at, not an audit. Its path is relative to the installation, for PSINS to
the source. ``missing_evidence`` tells which files no longer exist. A package without a mark has "no": nothing was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("filterpy", "Stone Soup", "pyins", "PSINS", "kalman-py", "dynamax", "sins_env")


class Mark(NamedTuple):
    """Whether a package has a feature, and how that is known."""

    text: str  #: "yes", or the part of the feature that it has
    evidence: str  #: path of a file


class Feature(NamedTuple):
    """A row of the table of features."""

    name: str
    marks: Mapping[str, Mark]  #: marks by package; a package without one has "no"


def yes(evidence: str) -> Mark:
    """Make the mark of a package that has the feature."""
    return Mark("yes", evidence)


FEATURES = (
    Feature(
        "runs on",
        {
            "filterpy": Mark("NumPy", "filterpy/kalman/kalman_filter.py"),
            "Stone Soup": Mark("NumPy", "stonesoup/predictor/kalman.py"),
            "pyins": Mark("NumPy, numba", "pyins/_numba_integrate.py"),
            "PSINS": Mark("MATLAB", "base/kf/kfupdate.m"),
            "kalman-py": Mark("NumPy, JAX", "kalman_py/backends/jax_backend.py"),
            "dynamax": Mark("JAX", "dynamax/linear_gaussian_ssm/inference.py"),
            "sins_env": Mark("NumPy, numba", "solvers/blocks/moments.py"),
        },
    ),
    Feature(
        "EKF, UKF for your own model",
        {
            "filterpy": yes("filterpy/kalman/UKF.py"),
            "Stone Soup": yes("stonesoup/predictor/kalman.py"),
            "PSINS": yes("base/kf/ukf.m"),
            "kalman-py": yes("kalman_py/ukf.py"),
            "dynamax": yes("dynamax/nonlinear_gaussian_ssm/inference_ukf.py"),
            "sins_env": yes("solvers/filters/sigma/ukf.py"),
        },
    ),
    Feature(
        "CKF",
        {
            # update() takes the points from before Q was added, for sigmas_f is not drawn anew
            "filterpy": Mark("without Q in the update", "filterpy/kalman/CubatureKalmanFilter.py"),
            "Stone Soup": yes("stonesoup/predictor/kalman.py"),
            "PSINS": yes("base/kf/ckf.m"),
            # UKFIntegrals(1, 0, 0)
            "dynamax": Mark("as a UKF", "dynamax/generalized_gaussian_ssm/inference.py"),
            "sins_env": yes("solvers/filters/sigma/ckf.py"),
        },
    ),
    Feature(
        "adaptive, robust, H-infinity",
        {
            # H-infinity, linear: "I do not believe this code is correct. DO NOT USE THIS."
            "filterpy": Mark("fading memory", "filterpy/memory/fading_memory.py"),
            "Stone Soup": Mark("sliding innovation", "stonesoup/updater/slidinginnovation.py"),
            # Sage-Husa, maximum correntropy, Student-t
            "PSINS": Mark("adaptive, robust", "base/kf/akfupdate.m"),
            "sins_env": yes("solvers/filters/hinfinity/hinf.py"),
        },
    ),
    Feature(
        "particle filters",
        {
            "filterpy": Mark("resampling", "filterpy/monte_carlo/resampling.py"),
            "Stone Soup": yes("stonesoup/predictor/particle.py"),
            "PSINS": yes("base/kf/pfupdate.m"),
            # Rao-Blackwellised, of switching linear models
            "dynamax": Mark("switching linear", "dynamax/slds/inference.py"),
            "sins_env": yes("solvers/filters/particles/pf.py"),
        },
    ),
    Feature(
        "smoothing",
        {
            "filterpy": yes("filterpy/kalman/UKF.py"),
            "Stone Soup": yes("stonesoup/smoother/kalman.py"),
            "PSINS": yes("base/kf/POSSmooth.m"),
            "kalman-py": yes("kalman_py/ukf.py"),
            "dynamax": yes("dynamax/nonlinear_gaussian_ssm/inference_ekf.py"),
            "sins_env": yes("solvers/smoothing.py"),
        },
    ),
    Feature(
        "learns models from data",
        {"kalman-py": Mark("noise", "kalman_py/learning.py"), "dynamax": yes("dynamax/ssm.py")},
    ),
    Feature("many targets, association", {"Stone Soup": yes("stonesoup/dataassociator/probability.py")}),
    Feature(
        "strapdown, SINS/GPS",
        {
            "pyins": yes("pyins/filters.py"),
            "PSINS": yes("base/kf/sinsgps.m"),
            "sins_env": yes("solvers/pipeline/estimator.py"),
        },
    ),
    Feature(
        "coarse alignment",
        {"PSINS": yes("base/align/aligni0.m"), "sins_env": yes("solvers/pipeline/coarse/__init__.py")},
    ),
    Feature(
        "large misalignment",
        {"PSINS": yes("demos/test_align_ukf.m"), "sins_env": yes("solvers/pipeline/errors/alignment.py")},
    ),
    Feature(
        "simulated motion, IMU",
        {
            "Stone Soup": Mark("motion", "stonesoup/simulator/simple.py"),
            "pyins": yes("pyins/sim.py"),
            "PSINS": yes("base/base1/trjsimu.m"),
            "sins_env": yes("sins_env/sensors/imu.py"),
        },
    ),
    Feature("Gymnasium environment", {"sins_env": yes("sins_env/envs/environments.py")}),
    Feature(
        "many runs at once",
        {
            "kalman-py": Mark("EKF on JAX", "kalman_py/backends/jax_backend.py"),
            "dynamax": yes("dynamax/nonlinear_gaussian_ssm/inference_ukf.py"),
            "sins_env": yes("solvers/filters/base.py"),
        },
    ),
    Feature(
        "GPU, gradients",
        {
            "kalman-py": yes("kalman_py/backends/jax_backend.py"),
            "dynamax": yes("dynamax/nonlinear_gaussian_ssm/inference_ekf.py"),
        },
    ),
    Feature(
        "Cramer-Rao bound",
        {
            "Stone Soup": yes("stonesoup/metricgenerator/pcrbmetric.py"),
            "sins_env": yes("sins_env/evaluation/bound/bounds.py"),
        },
    ),
    Feature("ranking with intervals", {"sins_env": yes("sins_env/evaluation/score/ranking.py")}),
)


def missing_evidence(package: str, folder: Path) -> list[str]:
    """Return the files named as evidence of a package that are not in the folder of its installation."""
    files = {feature.marks[package].evidence for feature in FEATURES if package in feature.marks}
    return sorted(file for file in files if not (folder / file).is_file())
