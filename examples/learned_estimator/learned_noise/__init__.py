"""A filter that learns how wrong the told noises are: theory keeps the INS, and a small recurrent network scales Q and R.

Read ``network``, which says what the network sees and answers, then ``estimator``. ``train`` alone needs PyTorch.
"""

from learned_noise.estimator import LearnedNoise

__all__ = ["LearnedNoise"]
