"""A learned policy that tunes a filter's noise
============================================

PPO against constant factors on ``SINS/TuneNoise-v0``, on runs that neither has seen::

    pip install stable-baselines3
    python examples/ppo_tune_noise.py                   # trains for 3 minutes of CPU time
    python examples/ppo_tune_noise.py --minutes 0       # the constants and the adaptive filter alone, without PPO

The filter is told wrong noise, and each second an action scales Q and R. The best constant is looked for on runs of its own, PPO
is trained on others, and all are compared on held-out ones. The table has the mean reward, which is minus the error over its
threshold (docs/learning.md#tuning), and paired differences with 95 % intervals. docs/learning.md#baselines has the constants and
filters.
"""

import argparse
import itertools
import time
from dataclasses import replace

import gymnasium
import numpy as np
from scipy.stats import bootstrap

from sins_env.evaluation.tasks.catalogue import get_task

CHOOSING, TRAINING, HELD_OUT = 1_000_000, 2_000_000, 3_000_000  #: first seeds; no run of one is a run of another
GRID = (-1.0, -2 / 3, -1 / 3, 0.0)  #: actions that are tried for Q and R


def played(env, policy, seed):
    """Return the mean reward of each row, for a policy from observations (rows, n) to actions (rows, 2)."""
    obs, _ = env.reset(seed=seed)
    total, steps, over = 0.0, 0, np.zeros(1, dtype=bool)
    while not over.any():
        obs, reward, _, over, _ = env.step(policy(obs))
        total, steps = total + reward, steps + 1
    return total / steps


def constant(action):
    return lambda obs: np.tile(action, (len(obs), 1))


def best_constant(env):
    """Return the action of the grid with the largest mean reward."""
    return max(itertools.product(GRID, GRID), key=lambda action: played(env, constant(action), CHOOSING).mean())


def difference(rewards, reference):
    """Return the mean paired difference, and its 95 % interval in words."""
    apart = rewards - reference
    low, high = bootstrap((apart,), np.mean, rng=0).confidence_interval if apart.any() else (0.0, 0.0)
    return f"{apart.mean():+.3f} [{low:+.3f}, {high:+.3f}]"


def lockstep(env):
    """Return a vector environment of Gymnasium as one of stable-baselines3, which begins the next episode in the last step."""
    from stable_baselines3.common.vec_env import VecEnv

    class Lockstep(VecEnv):
        def __init__(self):
            super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
            self.begun = False

        def reset(self):
            seed = None if self.begun else TRAINING
            self.begun = True
            return env.reset(seed=seed)[0]

        def step_async(self, actions):
            self.actions = actions

        def step_wait(self):
            obs, reward, _, over, _ = env.step(self.actions)
            infos = [{} for _ in over]
            if over.any():  # all rows end together
                infos = [{"terminal_observation": last, "TimeLimit.truncated": True} for last in obs]
                obs = self.reset()
            return obs, reward.astype(np.float32), over, infos

        def close(self):
            env.close()

        def get_attr(self, attr_name, indices=None):
            return [getattr(env, attr_name, None)] * env.num_envs

        # The base class asks for the next two; PPO calls neither.
        def set_attr(self, attr_name, value, indices=None):
            raise NotImplementedError

        def env_method(self, method_name, *args, indices=None, **kwargs):
            raise NotImplementedError

        def env_is_wrapped(self, wrapper_class, indices=None):
            return [False] * env.num_envs

    return Lockstep()


def trained(env, minutes):
    """Train PPO for so many minutes of CPU time, and return its policy and the number of steps."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(1)
    began = time.process_time()

    def goes_on(*_):
        return time.process_time() - began < 60 * minutes

    venv = VecNormalize(lockstep(env), norm_obs=False, gamma=0.99)
    agent = PPO(
        "MlpPolicy", venv, n_steps=120, batch_size=960, n_epochs=6, gamma=0.99, seed=0, device="cpu",
        learning_rate=1e-3, policy_kwargs={"log_std_init": -1.0},
    )  # fmt: skip
    agent.learn(10**9, callback=goes_on)
    return lambda obs: agent.predict(obs, deterministic=True)[0], agent.num_timesteps


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=3.0, help="training, minutes of CPU time (default 3; 0: none)")
    parser.add_argument("--task", default="sway-told-wrong-v0", help="default sway-told-wrong-v0")
    parser.add_argument("--solver", default="ckf", help="default ckf")
    parser.add_argument("--adaptive", default="aukf_window", help="a filter that adapts itself (default aukf_window)")
    parser.add_argument("--runs", type=int, default=32, help="runs of each set (default 32)")
    text = "actions of the constant for Q and R (default: the best of a grid, on runs of its own)"
    parser.add_argument("--constant", type=float, nargs=2, metavar=("A", "B"), help=text)
    parser.add_argument("--seconds", type=float, help="length of a run (default: that of the task)")
    parser.add_argument("--interval", type=float, default=1.0, help="how long an action holds, s (default 1)")
    given = parser.parse_args()

    task = get_task(given.task)
    if given.seconds:
        task = replace(task, kwargs={**task.kwargs, "duration": given.seconds})

    def make(solver):
        kwargs = {"task": task, "solver": solver, "interval_s": given.interval}
        return gymnasium.make_vec("SINS/TuneNoise-v0", num_envs=given.runs, **kwargs)

    env = make(given.solver)
    action = given.constant or best_constant(env)
    factors = 10.0 ** (env.unwrapped.core.settings.decades * np.array(action))
    policies = {
        "as told": (env, constant((0.0, 0.0))),
        f"constant: Q x {factors[0]:.3g}, R x {factors[1]:.3g}": (env, constant(action)),
        f"{given.adaptive}, as told": (make(given.adaptive), constant((0.0, 0.0))),
    }
    if given.minutes:
        try:
            policy, steps = trained(make(given.solver), given.minutes)
        except ModuleNotFoundError as error:
            raise SystemExit(f"{error.name} is not installed: pip install stable-baselines3, or --minutes 0") from None
        policies[f"PPO, {steps:,} steps"] = env, policy
    rewards = {name: played(where, policy, HELD_OUT) for name, (where, policy) in policies.items()}
    told, best, *_ = rewards.values()
    print(f"{given.solver} on {given.task}, {given.runs} held-out runs: mean reward, and differences paired by run")
    print(f"{'':36} {'reward':>8}   {'from as told':26} {'from the constant':26}")
    for name, values in rewards.items():
        print(f"{name:36} {values.mean():8.3f}   {difference(values, told):26} {difference(values, best):26}")


if __name__ == "__main__":
    main()
