"""Actions that correct an estimate instead of being one. docs/learning.md#corrections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from sins_env import attitude, checks, earth
from sins_env.arrays import Array, Obs
from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv
from sins_env.evaluation.estimators import finding
from sins_env.states import ERRORS, answered
from sins_env.types import NavState, Task
from sins_env.wrappers.translated import E, Info, Translation, own_env, translated


class Corrections(Translation):
    """Corrections of the last answer, or with a solver of its answer, in parts of ``scale``."""

    rank = 0

    def __init__(self, solver: Any, settings: Mapping[str, Any], scale: Array) -> None:
        self.solver, self.settings, self.scale = solver, dict(settings), scale
        self._estimator = None if solver is None else finding.make(solver, settings)

    def spaces(self, observed: spaces.Dict, action: spaces.Box) -> tuple[spaces.Dict, spaces.Box]:
        """Return the space of a correction, -1 to 1 in each component."""
        return observed, spaces.Box(-1.0, 1.0, self.scale.shape, np.float32)

    def begin(self, env: EpisodeEnv | EpisodeVectorEnv, obs: Obs, info: Info) -> None:
        """Begin with the told start; without one it is level, heading north, at rest at the site."""
        self._task: Task = env.task
        self._seen = 0
        start = info["start"]
        self._answer = self._joined(NavState(start["q_nb"], start["vel"], start["pos"]))
        if self._estimator is not None:
            runs = env.num_envs if isinstance(env, EpisodeVectorEnv) else 1
            rngs = [np.random.default_rng(s) for s in np.random.SeedSequence(0).spawn(runs)]
            self._estimator.reset(self._task, rngs if isinstance(env, EpisodeVectorEnv) else rngs[0], runs)

    def observed(self, obs: Obs) -> Obs:
        """Give an observation to the solver, whose answer the next action corrects; the empty one of the end is none."""
        self._seen += 1
        if self._estimator is not None and self._seen <= self._task.num_epochs:
            self._answer = np.asarray(self._estimator.step(obs))  # type: ignore[arg-type]
        return obs

    def answer(self, action: Array) -> Array:
        """Return the corrected estimate.

        Raises:
            ValueError: a correction that is not finite, which no later one could mend.
        """
        given = np.asarray(action, dtype=float) * self.scale
        if not np.isfinite(given).all():
            raise checks.refused("correction", action, "finite numbers")
        q = attitude.multiply(attitude.from_rotvec(given[..., :3]), self._answer[..., :4])
        parts = [attitude.normalize(q)]
        if self._task.navigate:
            place = earth.displace(earth.get(self._task.site.earth), self._answer[..., 7:], given[..., 6:])
            parts += [self._answer[..., 4:7] + given[..., 3:6], place]
        corrected = np.concatenate(parts, axis=-1)
        if self._estimator is None:
            self._answer = corrected
        return corrected

    def _joined(self, state: NavState) -> Array:
        return np.concatenate(state, axis=-1) if self._task.navigate else np.array(state.q_nb)


def corrections(
    env: E,
    solver: finding.Solver | None = None,
    settings: Mapping[str, Any] | None = None,
    scale: Any = None,
) -> E:
    """Return an environment whose actions are small corrections, (3,) or in navigation (9,), each -1 to 1.

    The first three are a rotation vector about East, North and Up, which turns the estimated attitude. In navigation velocity
    and position E, N, U follow. An action of zero leaves the estimate as it is.

    Args:
        env: an environment, single or vector.
        solver: name, class or function of the solver whose answer is corrected; it goes on with its own. None corrects the last
            answer, which begins with the told start.
        settings: settings of the solver.
        scale: what an action of 1 is, rad, m/s and m, (3,) or (9,); None takes the standard deviations of the told prior.

    Raises:
        ValueError: another environment, wrappers in another order, no such solver,
            settings without a solver, or a scale that does not fit.
    """
    task: Task = own_env(env).task
    if not isinstance(settings, Mapping | None) or (settings and solver is None):
        raise checks.refused("settings", settings, "a dict of settings of the solver; without a solver none")
    layout = answered(task.navigate)
    told = np.sqrt(np.diagonal(task.prior.P0))[ERRORS.places(layout)]
    if scale is not None:
        allowed = f"{layout.size} positive numbers, rad, m/s and m"
        told = np.array(checks.numbers("scale", scale, layout.size, allowed, above=0.0))
    return translated(env, Corrections(solver, settings or {}, told))
