"""sins_env: which filter aligns a strapdown inertial system fastest, and how far is it from the best possible?

The constitution. Everything inside is SI, radians and float64; degrees, arcsec, deg/h and micro-g appear only in spec
fields that carry the unit in their name, in the command line and in reports.

Frames     n: East-North-Up at the base; b: Right-Forward-Up of the IMU; i: inertial; e: Earth-fixed; c: the computed n.
Attitude   ``q_nb`` is a Hamilton quaternion, scalar first, that turns body vectors into n: v_n = q_nb v_b q_nb*,
           C_nb @ v_b = v_n. Heading is clockwise from north, pitch nose up, roll right side down.
Errors     computed minus true, measured minus true. The misalignment phi (E, N, U) turns n into c: C_hat = C_n^c(phi) C_nb.
Position   latitude rad, longitude rad, height m.
Shapes     batch first: (..., n) states and (..., n, n) covariances; one run is batch shape ().
Time       observation k covers (t_{k-1}, t_k]; the action is the estimate at t_k.

Symbols x P F Q H R K S stand for themselves inside the mathematics. Sources: 000 is Wang Junhou's thesis (2011), the other
documents are 001-004; equation numbers such as (2.2.17) are the thesis' own, misprints corrected.

Importing this package registers ``SINS/AlignSway-v0``, ``SINS/AlignStatic-v0``, ``SINS/AlignVehicle-v0``,
``SINS/NavFlight-v0`` and ``SINS/Replay-v0`` with Gymnasium.
"""

from sins_env import moved as _moved
from sins_env.envs import register as _register
from sins_env.prior import Prior
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, GpsSpec, ImuSpec
from sins_env.types import Estimator, NavState, Observation, Site, Task
from sins_env.version import VERSION

__version__ = VERSION
__all__ = [
    "GPS_PRESETS",
    "IMU_PRESETS",
    "Estimator",
    "GpsSpec",
    "ImuSpec",
    "NavState",
    "Observation",
    "Prior",
    "Site",
    "Task",
]

_moved.install()
_register()
