"""The pipeline around a filter: observations of an IMU and its aids come in, an attitude or a navigation state goes out.

Read it in the order of the data. ``coarse`` finds a first attitude, ``strapdown`` carries it on, ``errors`` says how its
errors grow, and ``aiding`` turns a reading into a measurement of them. ``integration`` puts these around the filter, and
``feedback`` takes the filter's estimate into the INS. ``settings`` are what a user can choose; ``estimator``, ``two_pass`` and
``coarse_only`` are the estimators.
"""
