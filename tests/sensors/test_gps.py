import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from sins_env import attitude, earth
from sins_env.checks import shown
from sins_env.motion import Motion
from sins_env.sensors.gps import Gps, epochs_per_fix
from sins_env.specs import GPS_PRESETS, GpsSpec
from sins_env.trajectory import THESIS, Sway
from sins_env.types import NavState, Site

WGS84 = earth.get("wgs84")
SITE = Site(np.radians(39.96), np.radians(116.3), 50.0)
EPOCH = 0.1


def streams(runs, seed=0):
    return [rng.spawn(3) for rng in np.random.default_rng(seed).spawn(runs)]


def still(runs, epochs):
    """A base at rest, level, heading north."""
    shape = (runs, epochs)
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*shape, 4))
    state = NavState(q, np.zeros((*shape, 3)), np.broadcast_to(SITE.pos, (*shape, 3)))
    nothing = np.zeros((*shape, 1, 3))
    return Motion(nothing, nothing, state, np.zeros((*shape, 3)))


def fixes(spec, runs, epochs, seed=0, first=0):
    gps = Gps(spec, EPOCH, epochs * EPOCH, WGS84)
    gps.reset(streams(runs, seed))
    return gps.fixes(still(runs, epochs), first)


def metres(pos):
    """East, North, Up of positions about the site."""
    R_M, R_N = earth.radii(WGS84, SITE.latitude)
    d = pos - SITE.pos
    east = d[..., 1] * (R_N + SITE.height) * np.cos(SITE.latitude)
    return np.stack([east, d[..., 0] * (R_M + SITE.height), d[..., 2]], axis=-1)


def test_noise_has_the_told_level_on_each_axis():
    spec = GpsSpec(vel_std_mps=(0.1, 0.2, 0.3), pos_std_m=(1.0, 2.0, 5.0))
    vel, pos, _ = fixes(spec, 100, 200)
    for values, std in ((vel, spec.vel_std), (metres(pos), spec.pos_std)):
        flat = values.reshape(-1, 3)
        assert np.all(np.abs(flat.std(axis=0) / std - 1) < 3 / np.sqrt(2 * len(flat)))
        assert np.all(np.abs(flat.mean(axis=0)) < 3.5 * std / np.sqrt(len(flat)))
    correlation = np.corrcoef(np.concatenate([vel, metres(pos)], axis=-1).reshape(-1, 6).T)
    assert np.abs(correlation - np.eye(6)).max() < 4 / np.sqrt(20000)


def test_perfect_fixes_are_the_truth():
    vel, pos, valid = fixes(GPS_PRESETS["perfect"], 2, 5)
    assert_array_equal(vel, 0.0)
    assert_allclose(pos, np.broadcast_to(SITE.pos, (2, 5, 3)), rtol=1e-15)
    assert valid.all()
    assert valid.dtype == np.int8


@pytest.mark.parametrize(("rate", "every"), [(10.0, 1), (5.0, 2), (1.0, 10), (1 / 3, 30)])
def test_rates(rate, every):
    spec = GpsSpec(rate_hz=rate)
    assert epochs_per_fix(spec, EPOCH) == every
    vel, pos, valid = fixes(spec, 2, 60)
    expected = (np.arange(1, 61) % every == 0)[None, :, None]
    assert_array_equal(valid, np.broadcast_to(expected, (2, 60, 1)))
    missing = ~expected[0, :, 0]
    assert not vel[:, missing].any()
    assert not pos[:, missing].any()


@pytest.mark.parametrize(("rate", "near"), [(3.0, "3.33333 Hz"), (20.0, "10 Hz"), (7.0, "10 Hz"), (1.01, "1 Hz")])
def test_rates_that_do_not_fit(rate, near):
    with pytest.raises(ValueError, match=f"GPS rate {rate:g} Hz with epochs of 0.1 s.*for instance {near}"):
        epochs_per_fix(GpsSpec(rate_hz=rate), EPOCH)


def test_rate_and_outages_leave_the_noise_as_it_was():
    full, _, _ = fixes(GpsSpec(), 2, 60)
    for spec in (GpsSpec(rate_hz=2.0), GpsSpec(outages_s=((1.0, 3.0),))):
        vel, _, valid = fixes(spec, 2, 60)
        assert_array_equal(vel, full * valid)
        assert 0 < valid.sum() < valid.size


def test_outages_are_open_at_their_start_and_closed_at_their_end():
    _, _, valid = fixes(GpsSpec(outages_s=((1.0, 2.0), (4.95, 5.05))), 1, 60)
    gone = 1 + np.flatnonzero(valid[0, :, 0] == 0)
    assert_array_equal(gone, [*range(11, 21), 50])


def test_fixes_do_not_depend_on_chunks_or_neighbours():
    spec = GpsSpec(contamination=0.3, jump_mps=1.0, jump_s=2.0, rate_hz=5.0)
    whole = fixes(spec, 3, 60)
    gps = Gps(spec, EPOCH, 6.0, WGS84)
    gps.reset(streams(3)[1:2])
    parts = [gps.fixes(still(1, 20), first) for first in (0, 20, 40)]
    for i in range(3):
        assert_array_equal(np.concatenate([p[i] for p in parts], axis=1)[0], whole[i][1])


def test_contamination_share_and_variance():
    share, factor = 0.1, 100.0
    vel, pos, _ = fixes(GpsSpec(vel_std_mps=1.0, contamination=share, contamination_factor=factor), 100, 500)
    clean, _, _ = fixes(GpsSpec(vel_std_mps=1.0), 100, 500)
    ratio = vel / clean
    hit = ratio[..., 0] > 2
    assert_allclose(ratio, np.where(hit, 10.0, 1.0)[..., None] * np.ones(3), rtol=1e-12)  # one factor per fix
    assert abs(hit.mean() - share) < 3 * np.sqrt(share * (1 - share) / hit.size)
    assert_allclose(metres(pos)[hit].std() / metres(pos)[~hit].std(), 10.0, rtol=0.03)
    variance = 1 + share * (factor - 1)
    fourth = 3 * (1 - share + share * factor**2)
    assert abs(np.mean(vel**2) - variance) < 3 * np.sqrt((fourth - variance**2) / hit.size)


@pytest.mark.parametrize("dof", [3.0, 8.0])
def test_heavy_tails_are_student_t(dof):
    spec = GpsSpec(vel_std_mps=0.2, heavy_tail_dof=dof)
    vel, _, _ = fixes(spec, 50, 400)
    assert stats.kstest(vel[..., 0].ravel() / 0.2, stats.t(dof).cdf).pvalue > 0.01
    assert stats.kstest(vel[..., 0].ravel() / 0.2, "norm").pvalue < 1e-6
    factor = vel / fixes(GpsSpec(vel_std_mps=0.2), 50, 400)[0]
    assert_allclose(factor, factor[..., :1] * np.ones(3), rtol=1e-9)  # one common factor per fix


def test_jump_in_a_stated_interval():
    spec = GpsSpec(vel_std_mps=0.0, jump_mps=2.0, jump_s=(1.0, 2.0))
    vel, _, _ = fixes(spec, 400, 60)
    inside = np.zeros(60, dtype=bool)
    inside[10:20] = True  # epochs 11 ... 20
    assert_allclose(np.linalg.norm(vel, axis=-1), np.broadcast_to(2.0 * inside, (400, 60)), atol=1e-12)
    assert_array_equal(vel[..., 2], 0.0)
    angle = np.arctan2(vel[:, 15, 0], vel[:, 15, 1]) / (2 * np.pi) % 1
    assert stats.kstest(angle, "uniform").pvalue > 0.01


def test_jump_of_stated_length_begins_at_random():
    vel, _, _ = fixes(GpsSpec(vel_std_mps=0.0, jump_mps=1.0, jump_s=2.0), 300, 100)
    hit = vel.any(axis=-1)
    assert_array_equal(hit.sum(axis=1), 20)
    first = hit.argmax(axis=1)
    assert_array_equal(hit.sum(axis=1), [h[f : f + 20].sum() for h, f in zip(hit, first, strict=True)])
    assert stats.kstest(first / 80, "uniform").pvalue > 0.001


def test_a_spoofer_pulls_velocity_and_position_off_together():
    """By a tau and a tau^2 / 2 in one direction of a run, in its interval; nothing else changes a bit."""
    noise = {"heavy_tail_dof": 5.0, "jump_mps": 1.0, "jump_s": 2.0}
    plain = fixes(GpsSpec(**noise), 200, 60)
    pulled = fixes(GpsSpec(**noise, spoof_mps2=0.5, spoof_s=(1.0, 4.0)), 200, 60)
    turn, start = np.stack([one[2].random(2) for one in streams(200)]).T  # the draws of a jump come first
    t = EPOCH * np.arange(1, 61)
    jump = np.sin(2 * np.pi * turn)[:, None] * ((t > 4 * start[:, None]) & (t <= 4 * start[:, None] + 2.0))
    assert_allclose(plain[0][..., 0], fixes(GpsSpec(heavy_tail_dof=5.0), 200, 60)[0][..., 0] + jump, atol=1e-12)
    tau = np.clip(EPOCH * np.arange(1, 61) - 1.0, 0.0, None) * (np.arange(1, 61) <= 40)
    for now, before in zip(pulled, plain, strict=True):
        assert_array_equal(now[:, tau == 0], before[:, tau == 0])
    vel, way = pulled[0] - plain[0], metres(pulled[1]) - metres(plain[1])
    assert_allclose(np.linalg.norm(vel, axis=-1), np.broadcast_to(0.5 * tau, (200, 60)), atol=1e-12)
    assert_allclose(way, 0.5 * tau[:, None] * vel, atol=1e-3)  # fixes 10 m from the site have other radii
    angle = np.arctan2(vel[:, 35, 0], vel[:, 35, 1]) / (2 * np.pi) % 1
    assert stats.kstest(angle, "uniform").pvalue > 0.01
    drawn = fixes(GpsSpec(vel_std_mps=0.0, spoof_mps2=1.0, spoof_s=2.0), 300, 100)[0].any(axis=-1)
    assert set(drawn.sum(axis=1)) <= {19, 20}  # the first epoch may begin with the pull
    assert stats.kstest(drawn.argmax(axis=1) / 80, "uniform").pvalue > 0.001
    told = GpsSpec(spoof_mps2=0.5, spoof_s=5.0).told()
    assert (told.spoof_mps2, told.spoof_s) == (0.0, 0.0)
    with pytest.raises(ValueError, match=r"spoof_mps2 = 0\.5 with spoof_s = 0\.0; allowed: both or neither"):
        GpsSpec(spoof_mps2=0.5)


def test_lever_arm_against_differences_of_the_antenna_position():
    lever = np.array([0.5, -1.0, 2.0])
    step = 0.01
    sway = Sway(SITE, step, 1, THESIS, heading_deg=None)
    sway.reset(np.random.default_rng(0).spawn(2))
    motion = sway.chunk(0, 400)
    gps = Gps(GpsSpec(vel_std_mps=0, pos_std_m=0, rate_hz=100.0, lever_arm_m=tuple(lever)), step, 4.0, WGS84)
    gps.reset(streams(2))
    vel, pos, _ = gps.fixes(motion, 0)
    C = attitude.to_dcm(motion.state.q_nb)
    assert_allclose(metres(pos), metres(motion.state.pos) + C @ lever, atol=2e-6)
    differences = (metres(pos)[:, 2:] - metres(pos)[:, :-2]) / (2 * step)
    assert np.abs(vel - motion.state.vel).max() > 0.3  # the arm matters
    assert_allclose(vel[:, 1:-1], differences, atol=2e-4)  # h^2/6 of the third derivative


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("vel_std_mps", -1.0),
        ("vel_std_mps", (1.0, 2.0)),
        ("pos_std_m", float("nan")),
        ("rate_hz", 0.0),
        ("lever_arm_m", (1.0, 2.0)),
        ("contamination", 1.5),
        ("outages_s", ((3.0, 2.0),)),
        ("jump_s", (5.0, 4.0)),
        ("vel_std_mps", "0.1"),
        ("vel_std_mps", [[1], [2, 3]]),
        ("vel_std_mps", None),
        ("pos_std_m", [1.0, 2.0, -3.0]),
        ("rate_hz", [1, 2]),
        ("rate_hz", np.inf),
        ("rate_hz", True),
        ("lever_arm_m", 3.0),
        ("lever_arm_m", "abc"),
        ("lever_arm_m", [1, 2, "3"]),
        ("outages_s", [1, 2]),
        ("outages_s", 5),
        ("outages_s", None),
        ("outages_s", [[1, 2, 3]]),
        ("outages_s", [[1, 2], [4, 3]]),
        ("contamination", [0.1, 0.2]),
        ("contamination_factor", [1, 2]),
        ("heavy_tail_dof", [3, 3]),
        ("jump_mps", [1.0, 2]),
        ("jump_mps", 10**400),
        ("jump_s", [5]),
        ("jump_s", [5, 6, 7]),
        ("jump_s", "5"),
        ("spoof_mps2", -0.1),
        ("spoof_s", (5.0, 4.0)),
    ],
)
def test_bad_specs_name_the_field_the_value_and_what_is_allowed(field, value):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        GpsSpec(**{field: value})
    message = str(error.value)
    assert message.startswith(f"GpsSpec.{field} = {shown(value)}")
    assert "; allowed: " in message or ": interval = " in message
    assert "inhomogeneous" not in message


def test_bad_intervals_are_named():
    with pytest.raises(
        ValueError, match=r"outages_s = \[\[1, 2\], \[4, 3\]\]: interval = \[4, 3\]; allowed: \(start, end\)"
    ):
        GpsSpec(outages_s=[[1, 2], [4, 3]])


def test_specs_hold_plain_values():
    given = GpsSpec(
        vel_std_mps=np.array([1, 2, 3]), rate_hz=np.float32(5), outages_s=np.array([[1, 2]]), jump_s=[1, np.int64(2)]
    )
    assert repr(given) == repr(
        GpsSpec(vel_std_mps=(1.0, 2.0, 3.0), rate_hz=5.0, outages_s=((1.0, 2.0),), jump_s=(1.0, 2.0))
    )
    assert "np." not in repr(given)
