"""Small NPZ files in the layouts of ../shared/data, with values that can be told apart."""

import numpy as np
from scipy.spatial.transform import Rotation

#: v_rfu = AXES @ v_file for a body with x backward, y right, z up
BACK_RIGHT_UP = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def attitudes(t):
    """A swaying body: scipy rotations of the Right-Forward-Up axes into East-North-Up."""
    angles = np.stack([-0.7 + 0.02 * np.sin(t), 0.05 * np.sin(2 * t), 0.03 * np.cos(t)], axis=-1)
    return Rotation.from_euler("ZXY", angles)


def counts(path, samples=1000, **changes):
    """100 Hz, as rlg_parked_car.npz: no GNSS, axes right, forward, up. A change of None drops the key."""
    k = np.arange(samples)[:, None]
    t = 0.1 * np.arange(1, samples // 10 + 1)
    arrays = {
        "fs_hz": np.float64(100.0),
        "t0_s": np.float64(0.0),
        "gyro_counts": (k + np.array([0, 100, 200])).astype(np.int16),
        "accel_counts": (-k + np.array([10, 20, 8000])).astype(np.int16),
        "gyro_lsb_rad": np.float64(4.8e-7),
        "accel_lsb_mps": np.float64(1.2e-5),
        "lat_deg": np.float64(34.2),
        "lon_deg": np.float64(108.9),
        "h_m": np.float64(380.0),
        "ref_t_s": t,
        "ref_q_b2n_wxyz": attitudes(t).as_quat(scalar_first=True),
    }
    return _save(path, arrays, changes)


def increments(path, samples=2400, **changes):
    """200 Hz, as navgrade_car_gps.npz: axes backward, right, up; fixes at 0.95 s + n, reference at 20 Hz."""
    rng = np.random.default_rng(0)
    tags = 0.005 * np.arange(samples)
    t = 0.05 * np.arange(1, samples // 10)
    fixes = np.arange(0.95, tags[-1], 1.0)
    to_file = Rotation.from_matrix(BACK_RIGHT_UP)  # v_n = R v_rfu = (R A) v_file
    llh = np.column_stack([34.0 + 1e-6 * fixes, 108.8 - 1e-6 * fixes, 400.0 + fixes])
    arrays = {
        "fs_hz": np.float64(200.0),
        "imu_t_s": tags,
        "dtheta_rad": 1e-5 * rng.standard_normal((samples, 3)),
        "dvel_mps": 0.005 * np.array([0.1, 0.2, 9.8]) + 1e-4 * rng.standard_normal((samples, 3)),
        "gnss_t_imu_s": fixes,
        "gnss_llh_deg_m": llh,
        "gnss_vel_enu_mps": np.column_stack([fixes, -fixes, 0.01 * fixes]),
        "ref_t_s": t,
        "ref_q_b2n_wxyz": (attitudes(t) * to_file).as_quat(scalar_first=True),
        "ref_vel_enu_mps": np.column_stack([t, -t, 0.1 * t]),
        "ref_llh_deg_m": np.column_stack([34.0 + 1e-6 * t, 108.8 - 1e-6 * t, 398.0 + t]),
        "lever_arm_est_body_m": np.array([0.985, -0.528, 2.021]),
    }
    return _save(path, arrays, changes)


def _save(path, arrays, changes):
    arrays = {key: value for key, value in {**arrays, **changes}.items() if value is not None}
    np.savez(path, **arrays)
    return str(path)
