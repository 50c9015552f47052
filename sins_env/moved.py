"""Import paths of version 0.1.0 that have changed. They work for one more version, with a DeprecationWarning."""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
import warnings
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

#: Old modules, each with the modules that hold its names now.
MOVED = {
    "sins_env.allan": "sins_env.sensors.allan",
    "sins_env.envs.align": "sins_env.envs.environments",
    "sins_env.envs.flight": "sins_env.worlds.flight sins_env.envs.environments",
    "sins_env.envs.flight_settings": "sins_env.worlds.flight",
    "sins_env.envs.replay": "sins_env.worlds.replay sins_env.envs.environments",
    "sins_env.envs.replay_settings": "sins_env.worlds.replay_settings",
    "sins_env.envs.settings": "sins_env.worlds.settings sins_env.worlds.sway",
    "sins_env.envs.vehicle": "sins_env.worlds.vehicle sins_env.envs.environments",
    "sins_env.envs.windows": "sins_env.worlds.windows",
    "sins_env.envs.world": "sins_env.worlds.world sins_env.worlds.simulated sins_env.worlds.sway",
    "sins_env.errors": "sins_env.checks",
    "sins_env.evaluation.bench": "sins_env.evaluation.speed.bench",
    "sins_env.evaluation.board": "sins_env.evaluation.score.results sins_env.evaluation.show.plain_tables",
    "sins_env.evaluation.bounds": "sins_env.evaluation.bound.bounds",
    "sins_env.evaluation.cache": "sins_env.evaluation.bound.cache",
    "sins_env.evaluation.catalogue": "sins_env.evaluation.tasks.catalogue",
    "sins_env.evaluation.check": "sins_env.evaluation.contract",
    "sins_env.evaluation.cli": "sins_env.cli.main sins_env.cli.command sins_env.cli.grammar sins_env.cli.arguments",
    "sins_env.evaluation.commands": (
        "sins_env.cli.verbs.run sins_env.cli.verbs.evaluate sins_env.cli.verbs.check sins_env.cli.verbs.bench"
    ),
    "sins_env.evaluation.consistency": "sins_env.evaluation.score.consistency",
    "sins_env.evaluation.contents": "sins_env.cli.describe.recording",
    "sins_env.evaluation.converting": "sins_env.cli.verbs.recordings",
    "sins_env.evaluation.cost": "sins_env.evaluation.speed.cost",
    "sins_env.evaluation.criteria": "sins_env.evaluation.play.criteria",
    "sins_env.evaluation.database": "sins_env.evaluation.store.database",
    "sins_env.evaluation.episode": "sins_env.evaluation.play.playing sins_env.evaluation.play.job sins_env.evaluation.play.one_run",
    "sins_env.evaluation.error_model": "sins_env.evaluation.bound.error_dynamics",
    "sins_env.evaluation.executors": "sins_env.evaluation.play.pool sins_env.evaluation.play.executors",
    "sins_env.evaluation.export": "sins_env.evaluation.store.export",
    "sins_env.evaluation.filling": "sins_env.evaluation.store.filling",
    "sins_env.evaluation.fisher": "sins_env.evaluation.bound.fisher",
    "sins_env.evaluation.flights": "sins_env.cli.describe.flight",
    "sins_env.evaluation.guard": "sins_env.evaluation.estimators.guard",
    "sins_env.evaluation.isolation": "sins_env.evaluation.estimators.isolation",
    "sins_env.evaluation.listing": "sins_env.cli.describe.listing sins_env.cli.describe.named",
    "sins_env.evaluation.metrics": "sins_env.evaluation.score.metrics",
    "sins_env.evaluation.navigation": "sins_env.evaluation.score.navigation",
    "sins_env.evaluation.outcome": "sins_env.cli.output sins_env.evaluation.show.style",
    "sins_env.evaluation.paired": "sins_env.evaluation.score.paired sins_env.evaluation.score.resampling",
    "sins_env.evaluation.plots": (
        "sins_env.evaluation.show.error_figure sins_env.evaluation.show.style sins_env.evaluation.show.run_figure"
    ),
    "sins_env.evaluation.progress": "sins_env.evaluation.play.progress",
    "sins_env.evaluation.quantities": "sins_env.evaluation.score.quantities",
    "sins_env.evaluation.ranking": "sins_env.evaluation.score.ranking",
    "sins_env.evaluation.records": "sins_env.evaluation.play.records",
    "sins_env.evaluation.registry": (
        "sins_env.evaluation.estimators.finding "
        "sins_env.evaluation.estimators.offers "
        "sins_env.evaluation.estimators.version"
    ),
    "sins_env.evaluation.repeatability": "sins_env.evaluation.score.repeatability",
    "sins_env.evaluation.replay_figure": "sins_env.evaluation.replay.angles_figure",
    "sins_env.evaluation.replaying": "sins_env.evaluation.replay.replaying sins_env.evaluation.replay.tables",
    "sins_env.evaluation.report_figures": "sins_env.evaluation.report.page_figures",
    "sins_env.evaluation.report_panel": "sins_env.evaluation.report.panel",
    "sins_env.evaluation.report_tables": "sins_env.evaluation.report.page_tables",
    "sins_env.evaluation.reproduction.car_readings": "sins_env.evaluation.reproduction.readings.car",
    "sins_env.evaluation.reproduction.command": "sins_env.cli.verbs.reproduce",
    "sins_env.evaluation.reproduction.navigation_pictures": "sins_env.evaluation.reproduction.pictures.navigation",
    "sins_env.evaluation.reproduction.pictures": "sins_env.evaluation.reproduction.pictures.courses",
    "sins_env.evaluation.reproduction.queueing": "sins_env.evaluation.store.filling",
    "sins_env.evaluation.reproduction.readings": "sins_env.evaluation.reproduction.readings.common",
    "sins_env.evaluation.reproduction.sway_readings": "sins_env.evaluation.reproduction.readings.sway",
    "sins_env.evaluation.reproduction.toy_pictures": "sins_env.evaluation.reproduction.pictures.toy",
    "sins_env.evaluation.resampling": "sins_env.evaluation.score.resampling",
    "sins_env.evaluation.rows": (
        "sins_env.evaluation.store.rows sins_env.evaluation.store.schema sins_env.evaluation.store.key"
    ),
    "sins_env.evaluation.scoring": "sins_env.evaluation.play.records sins_env.evaluation.play.errors",
    "sins_env.evaluation.spawning": "sins_env.evaluation.estimators.processes",
    "sins_env.evaluation.stored": "sins_env.cli.verbs.results_file",
    "sins_env.evaluation.svg": "sins_env.evaluation.report.svg",
    "sins_env.evaluation.templates": "sins_env.evaluation.show.templates",
    "sins_env.evaluation.terminal": "sins_env.evaluation.show.terminal_tables",
    "sins_env.evaluation.timing": "sins_env.evaluation.speed.timing",
    "sins_env.evaluation.track": "sins_env.evaluation.replay.track sins_env.evaluation.replay.tables",
    "sins_env.evaluation.track_figure": "sins_env.evaluation.replay.track_figure",
    "sins_env.evaluation.verify": "sins_env.evaluation.store.verify",
    "sins_env.evaluation.words": (
        "sins_env.evaluation.show.numbers "
        "sins_env.evaluation.show.columns "
        "sins_env.evaluation.score.ranking "
        "sins_env.evaluation.show.footer"
    ),
    "sins_env.figures": "sins_env.cli.describe.figures",
    "sins_env.gps": "sins_env.sensors.gps",
    "sins_env.imu": "sins_env.sensors.imu",
    "sins_env.memory": "sins_env.evaluation.estimators.memory",
    "sins_env.recordings.csv_files": "sins_env.recordings.formats.csv_files",
    "sins_env.recordings.kfgins": "sins_env.recordings.formats.kfgins",
    "sins_env.recordings.npz": "sins_env.recordings.formats.npz",
    "sins_env.recordings.psins": "sins_env.recordings.formats.psins_imu sins_env.recordings.formats.psins_mat",
    "sins_env.recordings.rows": "sins_env.recordings.assembling",
    "sins_env.recordings.units": "sins_env.recordings.column_units",
    "sins_env.trajectory.base": "sins_env.motion",
    "sins_env.trajectory.profiles": "sins_env.worlds.profiles",
    "sins_env.worlds.limits": "sins_env.sensors.limits",
    "solvers.blocks.angles": "solvers.filters.mixtures.angles",
    "solvers.blocks.hinfinity": "solvers.filters.hinfinity.inflation",
    "solvers.blocks.importance": "solvers.filters.particles.importance",
    "solvers.blocks.points_random": "solvers.filters.particles.random_points",
    "solvers.blocks.robust": "solvers.filters.robust.reweighting",
    "solvers.filters.asmugsf": "solvers.filters.mixtures.asmugsf",
    "solvers.filters.augmented_aukf": "solvers.filters.adaptive.augmented_aukf",
    "solvers.filters.aukf": "solvers.filters.adaptive.aukf",
    "solvers.filters.cgpf": "solvers.filters.particles.cgpf",
    "solvers.filters.ckf": "solvers.filters.sigma.ckf",
    "solvers.filters.ckf5": "solvers.filters.sigma.ckf5",
    "solvers.filters.ddf": "solvers.filters.sigma.ddf",
    "solvers.filters.ekf": "solvers.filters.kalman.ekf",
    "solvers.filters.filterpy_adapter": "solvers.filters.kalman.filterpy_adapter",
    "solvers.filters.gaussian_particles": "solvers.filters.particles.gaussian_particles",
    "solvers.filters.gm_ekf": "solvers.filters.robust.gm_ekf",
    "solvers.filters.gpf": "solvers.filters.particles.gpf",
    "solvers.filters.gsf_ekf": "solvers.filters.mixtures.gsf_ekf",
    "solvers.filters.hinf": "solvers.filters.hinfinity.hinf",
    "solvers.filters.hinf_uif": "solvers.filters.hinfinity.hinf_uif",
    "solvers.filters.huber_ckf": "solvers.filters.robust.huber_ckf",
    "solvers.filters.iekf": "solvers.filters.kalman.iekf",
    "solvers.filters.imm": "solvers.filters.mixtures.imm",
    "solvers.filters.inekf": "solvers.filters.kalman.inekf",
    "solvers.filters.kf": "solvers.filters.kalman.kf",
    "solvers.filters.mcc_ckf": "solvers.filters.robust.mcc_ckf",
    "solvers.filters.mixed_hinf_ukf": "solvers.filters.hinfinity.mixed_hinf_ukf",
    "solvers.filters.mixture": "solvers.filters.mixtures.base",
    "solvers.filters.mpf": "solvers.filters.kalman.mpf",
    "solvers.filters.particle_filter": "solvers.filters.particles.particle_filter",
    "solvers.filters.pf": "solvers.filters.particles.pf",
    "solvers.filters.registry": "solvers.registry",
    "solvers.filters.sigma_point": "solvers.filters.sigma.sigma_point",
    "solvers.filters.square_root": "solvers.filters.sigma.square_root",
    "solvers.filters.student_t_ckf": "solvers.filters.robust.student_t_ckf",
    "solvers.filters.ukf": "solvers.filters.sigma.ukf",
    "solvers.filters.upf": "solvers.filters.particles.upf",
    "solvers.pipeline.aligner": "solvers.pipeline.estimator",
    "solvers.pipeline.coarse.estimators": "solvers.pipeline.coarse_only",
    "solvers.pipeline.epoch_map": "solvers.pipeline.errors.model solvers.pipeline.aiding.gps",
    "solvers.pipeline.error_state": "solvers.pipeline.errors.alignment",
    "solvers.pipeline.invariant": "solvers.pipeline.errors.invariant",
    "solvers.pipeline.navigation_errors": "solvers.pipeline.errors.navigation",
    "solvers.pipeline.navigator": "solvers.pipeline.estimator",
    "solvers.pipeline.pipeline": "solvers.pipeline.estimator",
}


def forward(old: str, new: Sequence[str]) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for the module ``old`` that finds its names in the modules ``new``."""

    def find(name: str) -> Any:
        for module in map(importlib.import_module, new) if not name.startswith("__") else ():
            if hasattr(module, name):
                return getattr(module, name)
        raise AttributeError(f"module {old!r} has no attribute {name!r}")

    return find


class _Finder:
    """Finder and loader of the old modules. Each is empty, and looks its names up in the new modules."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        if fullname not in MOVED:
            return None
        return importlib.machinery.ModuleSpec(fullname, self)  # type: ignore[arg-type]  # importlib.abc is slow to import

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        """Return None, which asks Python for an ordinary module."""

    def exec_module(self, module: ModuleType) -> None:
        new = MOVED[module.__name__].split()
        text = f"{module.__name__} has moved to {' and '.join(new)}; the old name ends with version 0.3"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        module.__getattr__ = forward(module.__name__, new)  # type: ignore[method-assign]


def install() -> None:
    """Make the old modules importable. Real modules come first, and a second call changes nothing."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
