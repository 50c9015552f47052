"""The bare loop of the environment
================================

A swaying base, and the trivial estimate that the attitude stays as told.
"""

import gymnasium

import sins_env  # noqa: F401  (registers the environments)

env = gymnasium.make("SINS/AlignSway-v0", duration=30.0)
obs, info = env.reset(seed=1)
q_nb = info["start"]["q_nb"]
truncated, score = False, 0.0
while not truncated:
    obs, reward, _, truncated, info = env.step(q_nb)
    score += reward
print(f"mean misalignment of doing nothing: {-score / 300:.1f} deg")
