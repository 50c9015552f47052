"""The bound as an answer: its budget and its parts against dense algebra, what it tends to, and the verb."""

import dataclasses
import json
from functools import partial

import numpy as np
import pytest

import sins_env
from sins_env.cli.verbs import bound as verb
from sins_env.evaluation import get_task
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, simulated, true_motion
from sins_env.evaluation.planning import tables
from sins_env.evaluation.planning.compute import forecast
from sins_env.evaluation.planning.family import bound, varied
from sins_env.evaluation.planning.quantities import QUANTITIES, wanted
from sins_env.evaluation.planning.sources import sources
from sins_env.units import ARCSEC, DEG

AIDED = dataclasses.replace(
    get_task("flight-zhao2010-v0"),
    name="aided-v0",
    kwargs={
        "profile": "zhao2010",
        "duration": 24.0,
        "epoch": 1.0,
        "imu": {"gyro_markov_deg_h": 3.0},
        "aids": {"dvl": {"track": "water", "rate_hz": 0.5}, "height": {"noise_m": 0.3}},
    },
)


class Dense:
    """All epochs of one run at once: the last state and all readings as linear functions of what is drawn.

    The first numbers drawn are the errors of the start. Each epoch adds the noise before its transition and the noise after it.
    """

    def __init__(self, task):
        public, world = simulated(task)
        self.model = model = ErrorDynamics(world)
        state, rows, self.added, self.noise = np.eye(model.n), [], [], []
        for part in true_motion(task, public, 1):
            F, readings, density = model.transitions(part), model.readings(part), model.densities(part)
            for k in range(len(part.fix)):
                step = F[0, k]
                state = np.hstack([step @ state, step, np.eye(model.n)])
                rows = [np.hstack([H, np.zeros((len(H), 2 * model.n))]) for H in rows]
                self.added.append(0.5 * density[k] * model.epoch_s)
                for one in readings:
                    if one.there[k]:
                        rows.append(one.H[0, k] @ state)
                        self.noise.append((one.name, np.diag(one.R)))
        self.A, self.B = state, np.vstack(rows)

    def drawn(self, start, drive, noise):
        """Variances of what is drawn and of the noise of the readings, if only these masks count."""
        C = np.concatenate([np.diag(self.model.P0) * start, *(part * drive for part in self.added for _ in range(2))])
        return C, np.concatenate([variance * noise(name, len(variance)) for name, variance in self.noise])

    def gain(self, C, R):
        S = (self.B * C) @ self.B.T + np.diag(R)
        return np.linalg.solve(S, (self.B * C) @ self.A.T).T

    def covariance(self, C, R, K):
        left = self.A - K @ self.B
        return (left * C) @ left.T + (K * R) @ K.T


def test_the_budget_is_that_of_dense_algebra():
    """Shares by the optimal gain, and the bound without each source, in a flight with two aids and wandering biases."""
    dense, found = Dense(AIDED), forecast(AIDED)
    model, whole = dense.model, dense.drawn(1, 1, lambda name, m: np.ones(m))
    K = dense.gain(*whole)
    total = dense.covariance(*whole, K)
    sizes = {name: partial(QUANTITIES[name].size, states=model.states) for name in found.sigma}
    for name, size in sizes.items():
        np.testing.assert_allclose(found.final(name), size(np.diag(total)), rtol=1e-8)
    parts = sources(model)
    assert {"dvl, current", "height, noise", "gyro bias, wandering", "fixes of position"} <= set(found.sources)
    assert tuple(one.name for one in parts) == found.sources
    for s, one in enumerate(parts):
        own = dense.drawn(one.start, one.drive, lambda name, m, one=one: one.noise.get(name, np.zeros(m)))
        share = np.diag(dense.covariance(*own, K))
        for name, size in sizes.items():
            expected = (size(share) / size(np.diag(total))) ** 2
            np.testing.assert_allclose(found.shares[name][-1, s], expected, rtol=1e-6, atol=1e-9)
        if one.noise:
            continue  # a sensor without noise makes S of the dense problem singular
        rest = dense.drawn(~one.start, ~one.drive, lambda name, m: np.ones(m))
        without = np.diag(dense.covariance(*rest, dense.gain(*rest)))
        for name, size in sizes.items():
            np.testing.assert_allclose(found.without[name][-1, s], size(without), rtol=1e-6)
    for part in found.shares.values():
        np.testing.assert_allclose(part.sum(axis=1), 1.0, rtol=1e-9)


def test_without_the_noise_of_fixes_they_are_perfect(short):
    """The bound without a sensor's noise is that of the same task whose sensor has none."""
    found = forecast(short)
    perfect = forecast(varied(short, "gps.vel_std_mps", 1e-6), budget=False, runs=4)
    without = found.without["azimuth"][-1, found.sources.index("fixes of velocity")]
    np.testing.assert_allclose(without, perfect.final("azimuth"), rtol=2e-2)  # of 16 and 4 runs, which move otherwise


def test_perfect_sensors(short):
    """Variances that vanish, and are below zero by rounding, give no error and no NaN."""
    found = forecast(varied(varied(short, "imu", "perfect"), "gps", "perfect"), runs=2)
    assert found.final("azimuth") < 1e-3 * DEG
    json.dumps(found.to_dict(), allow_nan=False)


def test_it_is_the_bound_of_the_board(short):
    found, board = forecast(short, budget=False), bounds.compute(short)
    np.testing.assert_allclose(found.sigma["azimuth"][9::10], board.sigma[:, 2], rtol=1e-9)
    np.testing.assert_allclose(found.sigma["level"][9::10] ** 2, (board.sigma[:, :2] ** 2).mean(axis=1), rtol=1e-9)


def test_what_it_tends_to_is_a_longer_task():
    """A base at rest repeats itself exactly. One epoch of 1 s is repeated, so that times agree to a second."""
    still = dataclasses.replace(
        get_task("sway-white-v0"),
        env_id="SINS/AlignStatic-v0",
        kwargs={"duration": 40.0, "epoch": 1.0, "n_sub": 2, "gps": {"rate_hz": 1.0}},
    )
    long = forecast(varied(still, "duration", 237.0), budget=False, runs=1)
    target = long.at("azimuth", 180.0)
    (found,) = forecast(still, f"{target * 1.0001 / DEG}deg", budget=False, runs=1).reached
    assert np.isinf(found.first_s)
    assert found.later_s == 180.0
    floor = 0.02 / 15.041 / np.cos(np.radians(39.96))  # gyro bias over the earth's rate, rad
    day = forecast(varied(still, "imu.arw_deg_sqrt_h", 1e-6), budget=False, runs=1)
    np.testing.assert_allclose(day.limit["azimuth"], floor, rtol=2e-3)
    assert day.settled["azimuth"]


def test_when_it_is_reached(short):
    found = forecast(short, ["11deg", "level=100arcsec", "0.001deg"], budget=False)
    first, level, never = found.reached
    for one, curve in ((first, found.sigma["azimuth"]), (level, found.sigma["level"])):
        k = round(one.first_s / 0.1)
        assert curve[k - 1] <= one.wanted.size < curve[k - 2]
        assert one.holds_s == one.first_s
    assert np.isinf(never.first_s)
    assert never.best == found.final("azimuth")
    assert "never within the 20 s" in tables.sentence(found, never)
    assert f"from {first.holds_s:.0f} s on" in tables.sentence(found, first)


def test_an_accuracy_that_is_lost_again():
    """An outage at the end: reached, but not to the end."""
    task = dataclasses.replace(
        AIDED, kwargs={"profile": "zhao2010", "duration": 40.0, "gps": {"outages_s": [[20, 40]]}}
    )
    found = forecast(task, ["4m", "1m"], budget=False)
    lost, never = found.reached
    assert lost.first_s < 20
    assert np.isinf(lost.holds_s)
    assert "does not hold" in tables.sentence(found, lost)
    assert "grows without end" in tables.sentence(found, never)


@pytest.mark.parametrize(
    ("given", "quantity", "size"),
    [("0.1deg", "azimuth", 0.1 * DEG), ("level=20 arcsec", "level", 20 * ARCSEC), ("5cm/s", "velocity", 0.05),
     ("2e1m", "position", 20.0), ("height=1m", "height", 1.0), ("azimuth=3'", "azimuth", DEG / 20)],
)  # fmt: skip
def test_wanted_accuracies(given, quantity, size):
    ((_, name, found),) = wanted(given)
    assert name == quantity
    assert found == pytest.approx(size)


@pytest.mark.parametrize(
    ("given", "said"),
    [("0.1", "with a unit"), ("deg", "with a unit"), ("-1deg", "a positive number"), ("0m", "a positive number"),
     ("1degs", "did you mean 'deg'"), ("levl=1deg", "did you mean 'level'"), ("level=1m", "a unit of level"),
     ("height=1m", "has azimuth, level, velocity"), ("1e999m", "a positive number")],
)  # fmt: skip
def test_refused_accuracies(short, given, said):
    with pytest.raises(ValueError, match=said):
        forecast(short, given, budget=False)


def test_a_family_is_the_task_with_other_settings(short):
    found = sins_env.bound(short, compare={"gps.rate_hz": [2, 10], "imu": ["tactical"]}, budget=False)
    assert list(found.family) == ["gps.rate_hz = 2, imu = tactical", "gps.rate_hz = 10, imu = tactical"]
    kwargs = {**short.kwargs, "gps": {"preset": "thesis", "rate_hz": 2}, "imu": "tactical"}
    by_hand = dataclasses.replace(short, kwargs=kwargs)
    np.testing.assert_array_equal(
        found.family["gps.rate_hz = 2, imu = tactical"].sigma["azimuth"],
        forecast(by_hand, budget=False).sigma["azimuth"],
    )
    assert varied(short, "imu.vrw_ug_sqrt_hz", 7.0).kwargs["imu"] == {"preset": "thesis-white", "vrw_ug_sqrt_hz": 7.0}
    for key, to in (("duration_s", "duration"), ("site.latitude_deg", "latitude_deg"), ("duration", "duration")):
        assert varied(short, key, 7.0).kwargs[to] == 7.0
    sea = varied(varied(short, "motion", {"heave": {}}), "motion.spectrum.height_m", 7.0)
    assert sea.kwargs["motion"] == {"heave": {}, "spectrum": {"height_m": 7.0}}


@pytest.mark.parametrize(
    ("compare", "said"),
    [({"gps.rte_hz": [1]}, "did you mean 'rate_hz'"), ({"gps.rate_hz": 1}, "a list of values"), ({"epoch": []}, "a list of values"),
     ({"latitude_deg.x": [1]}, "has no field 'x'"), ({"epoch": [0.1] * 25}, "at most 24"), ({"durations": [3]}, "duration")],
)  # fmt: skip
def test_refused_families(short, compare, said):
    with pytest.raises(ValueError, match=said):
        bound(short, compare=compare, budget=False)


@pytest.mark.parametrize(("name", "why"), [("vehicle-v0", "no law"), ("rlg-car-v0", "no simulated truth")])
def test_tasks_without_a_bound_say_why(name, why):
    with pytest.raises(ValueError, match=why):
        forecast(name)


def test_the_verb(cli, short):
    code, out, _ = cli("bound", "short-v0", "--json", "--until", "1arcsec", "--compare", "imu=perfect,tactical")
    told = json.loads(out)
    assert code == 0
    assert told["until"][0]["first_s"] is None
    assert list(told["family"]) == ["imu = perfect", "imu = tactical"]
    assert sum(row["share"]["azimuth"] for row in told["budget"]) == pytest.approx(1.0)
    code, out, _ = cli("bound", "short-v0", "--compare", "imu=navigation")
    assert code == 0
    assert "imu = navigation" in out
    assert "Counted as known in some, whose errors are larger: scale_ppm" in out
    code, _, err = cli("bound", "short-v0", "--at", "21")
    assert code == 2
    assert "0 to 20 s" in err[0]


def test_labels_of_the_figure_do_not_overlap(cli, short, monkeypatch):
    """Titles, labels of axes and legends, drawn and measured."""
    drawn = []
    monkeypatch.setattr(verb, "save_figure", lambda figure, path: drawn.append(figure))
    wanted = ("--until", "12deg", "0.5deg", "level=100arcsec")
    code, out, _ = cli("bound", "short-v0", *wanted, "--at", "10", "--plot", "a.png")
    assert code == 0
    assert "what limits it at 10 s" in out
    assert "12deg of azimuth: from" in out
    (figure,) = drawn
    figure.draw_without_rendering()
    boxes = [legend.get_window_extent() for legend in figure.legends]
    for axes in figure.axes:
        texts = [axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label]
        boxes += [text.get_window_extent() for text in texts if text.get_text()]
    assert len(boxes) > 12
    for i, a in enumerate(boxes):
        assert not any(a.overlaps(b) for b in boxes[:i])


def test_a_notebook_shows_the_tables_and_the_figure(short, tmp_path):
    found = bound(short, until="1deg", compare={"gps.rate_hz": [1]})
    shown = found._repr_html_()
    assert "1deg of azimuth" in shown
    assert "gps.rate_hz = 1" in shown
    assert found.plot(tmp_path / "a.png")._repr_png_()[:4] == (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert type(found.family["gps.rate_hz = 1"]) is type(found)
