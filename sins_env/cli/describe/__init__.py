"""What ``sins-env list`` and ``sins-env describe`` show: tasks, solvers, presets, flights and recordings."""
