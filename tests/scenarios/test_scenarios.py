"""A scenario is a file: every key is refused with its line, and what it says is what the environment gets."""

import dataclasses
import itertools
import json
import warnings

import gymnasium
import numpy as np
import pytest
import yaml
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_array_equal
from places import ROOT

from sins_env.cli.describe.scenario import key_rows, scenario_of
from sins_env.envs.environments import ENVIRONMENTS
from sins_env.evaluation.tasks import catalogue
from sins_env.evaluation.tasks.catalogue import get_task, load, register, thresholds
from sins_env.reading.located import read_located
from sins_env.scenarios.motions import KINDS
from sins_env.scenarios.scenario import Scenario
from sins_env.scenarios.table import every_key

FERRY = """\
name: ferry-v0
what: a ferry at the quay
motion:
  kind: sway
  roll:  {amplitude_deg: 4.0, period_s: 9.5}
  pitch:
    - {amplitude_deg: 1.5, period_s: 6.0}
    - {amplitude_deg: 0.2, period_s: 3.0, phase_deg: 10}
  surge: {amplitude_m: 0.1, period_s: 8.0}
site: {latitude_deg: 54.3, longitude_deg: 10.1, height_m: 3, heading_deg: any}
imu: {preset: navigation, arw_deg_sqrt_h: 0.003}
gps: {vel_std_mps: 0.03, rate_hz: 5, outages_s: [[12, 18]]}
aids:
  depth: {}
start: {kind: told, attitude_std_deg: [0.5, 0.5, 8], velocity_std_mps: 0.1}
told:
  imu: tactical
  prior: matched
epoch_s: 0.1
samples_per_epoch: 20
duration_s: 60
score: {azimuth_deg: 0.5, level_arcsec: 60, hold_s: 10}
"""


@pytest.fixture
def file(tmp_path):
    def write(text, name="ferry.yaml"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def test_what_a_file_says_is_what_the_world_is(file):
    task = get_task(file(FERRY))
    assert (task.name, task.env_id, task.delta_azimuth_deg, task.hold_s) == ("ferry-v0", "SINS/AlignSway-v0", 0.5, 10)
    env = task.make(4)
    public, world = env.unwrapped.task, env.unwrapped.episode.world
    assert (public.n_sub, public.num_epochs, public.coarse_s, public.epoch_s) == (20, 600, 0.0, 0.1)
    assert_array_equal(public.site.pos, [np.radians(54.3), np.radians(10.1), 3.0])
    assert (world.imu.spec.arw_deg_sqrt_h, world.imu.spec.gyro_bias_deg_h) == (0.003, 0.005)
    assert (public.imu.arw_deg_sqrt_h, public.prior.gyro_bias_std_deg_h > 1) == (0.1, True)  # told otherwise
    assert (public.prior.attitude_std_deg, public.prior.velocity_std_mps) == ((0.5, 0.5, 8), 0.1)
    assert (world.gps.spec.rate_hz, world.gps.spec.outages_s, public.gps.outages_s) == (5, ((12, 18),), ())
    assert [aid.name for aid in public.aids] == ["depth"]
    _, info = env.reset(seed=1)
    assert info["start"]["known"].all()
    components = world.trajectory.motion.components
    assert {axis: [one.amplitude for one in ones] for axis, ones in components.items() if ones} == {
        "roll": [4.0], "pitch": [1.5, 0.2], "surge": [0.1],
    }  # fmt: skip


#: A change of the file, the line that the error names, and what it says.
BAD = {
    "range": ("arw_deg_sqrt_h: 0.003", "arw_deg_sqrt_h: -1", 11, "imu.arw_deg_sqrt_h = -1; allowed: a finite number"),
    "preset": ("preset: navigation", "preset: navigaton", 11, "did you mean 'navigation'?"),
    "component": ("amplitude_deg: 0.2", "amplitude_deg: 95", 6, "amplitudes of pitch add up to 96.5; allowed: at most 80"),
    "axis": ("  roll: ", "  rol: ", 5, "unknown key of motion 'rol'; did you mean 'roll'?"),
    "key": ("duration_s", "duraton_s", 21, "unknown key of a scenario 'duraton_s'; did you mean 'duration_s'?"),
    "kind": ("kind: sway", "kind: swai", 4, "unknown motion.kind 'swai'; did you mean 'sway'?"),
    "other kind": ("kind: sway", "kind: still", 5, "motion.roll with a motion of kind still; allowed: with sway only"),
    "together": ("duration_s: 60", "duration_s: 60.05", 21, "duration_s = 60.05 s with epochs of 0.1 s; allowed: a whole"),
    "fixes": ("rate_hz: 5", "rate_hz: 3", 12, "for instance 3.33333 Hz"),
    "latitude": ("54.3", "94.3", 10, "site.latitude_deg = 94.3; allowed: -89.9 to 89.9"),
    "list": ("[0.5, 0.5, 8]", "[0.5, 8]", 15, "start.attitude_std_deg = [0.5, 8]; allowed: three positive numbers"),
    "coarse": ("kind: told", "kind: told, coarse_s: 9", 15, "start.coarse_s = 9.0 with start.kind = 'told'; allowed: 0"),
    "aid": ("  depth: {}", "  deph: {}", 14, "aids: unknown aid 'deph'; did you mean 'depth'?"),
    "aid's field": ("depth: {}", "depth: {rate_hz: -2}", 14, "aids.depth.rate_hz = -2; allowed: a positive number"),
    "told": ("imu: tactical", "imu: tacticl", 17, "told.imu: unknown IMU preset 'tacticl'"),
    "object": ("score: {azimuth_deg: 0.5, level_arcsec: 60, hold_s: 10}", "score: 3", 22, "score = 3; allowed: an object with"),
    "rank": ("hold_s: 10", "rank_by: azimut", 22, "unknown score.rank_by 'azimut'; did you mean 'azimuth'?"),
    "bool": ("epoch_s: 0.1", "epoch_s: yes", 19, "epoch_s = True; allowed: a positive number of seconds"),
    "twice": ("epoch_s: 0.1", "epoch_s: 0.1\nepoch_s: 0.1", 20, "the key 'epoch_s' twice"),
    "tag": ("epoch_s: 0.1", "epoch_s: !!python/object:os.x 0", 19, "could not determine a constructor for the tag"),
    "name": ("name: ferry-v0", "name: a ferry", 1, "name = 'a ferry'; allowed: letters, digits"),
    "suite's name": ("name: ferry-v0", "name: sway-white-v0", 1, "name = 'sway-white-v0', which a task of the suite has"),
    "digest": ("name: ferry-v0", "digest: '1234'", 1, "digest = '1234'; allowed: "),
    "preset and axes": ("  kind: sway", "  preset: thesis", 5, "motion.roll with motion.preset; allowed: one of them"),
    "tab": ("  kind: sway", "\tkind: sway", 4, "allowed: spaces instead of the tab"),
    "no table": ("  kind: sway", "  table: t.csv\n  kind: track", 4, "motion.table: no file 't.csv'; allowed: the path"),
    "ranked by": ("hold_s: 10", "rank_by: position", 22, "score.rank_by = 'position'; allowed: azimuth, failures"),
    "scored from": ("hold_s: 10", "from_s: 9", 22, "score.from_s = 9.0; allowed: 0, for solvers return the attitude alone"),
    "held for": ("hold_s: 10", "hold_s: 61", 22, "score.hold_s = 61.0; allowed: at most 60, the seconds that are scored"),
    "segment": ("  kind: sway", "  segments: [[climb, 3]]\n  kind: flight", 4, "motion.segments[0] = ['climb', 3]"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_an_error_names_the_line_and_what_is_allowed(file, case):
    before, after, line, message = BAD[case]
    assert FERRY.count(before) >= 1
    path = file(FERRY.replace(before, after, 1))
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        load(path)
    assert str(error.value).startswith(f"{path}: line {line}")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_json_has_lines_too(file):
    given = {
        "name": "x",
        "motion": {"kind": "sway", "roll": [{"amplitude_deg": 1}, {"amplitude_deg": -1}]},
        "epoch_s": 0.1,
    }
    path = file(json.dumps(given, indent=1), "x.json")
    found = read_located(path)
    lines = path.read_text().splitlines()
    assert found.value == given
    assert '"motion"' in lines[found.lines[("motion",)] - 1]
    assert "-1" in lines[found.lines[("motion", "roll", 1, "amplitude_deg")] - 1]
    with pytest.raises(
        ValueError, match=rf"x.json: line {found.lines[('motion', 'roll')] + 2}: motion.roll.amplitude_deg = -1"
    ):
        Scenario.of(path)


def test_a_bomb_costs_nothing(file):
    """Nested aliases of 10^10 values are refused before they are expanded."""
    names = "abcdefghij"
    lines = [f"{a}: &{a} [{', '.join(f'*{b}' for _ in range(10))}]" for b, a in itertools.pairwise(names)]
    path = file("\n".join(["a: &a [x]", *lines]))
    with pytest.raises(ValueError, match=r"ferry.yaml: line \d+: more than 200000 values"):
        Scenario.of(path)


def test_a_dict_of_nothing_is_a_scenario():
    """Everything has a default: the thesis' sway with the thesis' sensors."""
    assert Scenario.of({}).env_id == "SINS/AlignSway-v0"
    for kind in KINDS.values():
        assert kind.env_id in ENVIRONMENTS
        assert issubclass(kind.settings, ENVIRONMENTS[kind.env_id].single.settings)
        if kind.name not in ("recording", "track"):  # they need a file
            ENVIRONMENTS[kind.env_id].single.make_world(dict(Scenario.of({"motion": kind.name}).kwargs))


def test_every_setting_of_the_environments_has_a_key():
    """So that a file can say all that a keyword argument can."""
    for kind in KINDS.values():
        targets = {kind.target(key).partition(".")[0] for key, kinds in every_key().values() if kind in kinds}
        settings = {field.name for field in dataclasses.fields(kind.settings)}
        assert settings - targets == ({"motion"} if kind.name == "still" else set()), kind.name
    fields = {field.name for field in dataclasses.fields(catalogue.EvaluationTask)} - {"env_id", "kwargs", "records"}
    assert {f"task.{name}" for name in fields} <= {key.to for key, _ in every_key().values()}


def test_the_table_in_the_docs_is_that_of_the_keys():
    page = (ROOT / "docs" / "scenarios.md").read_text()
    for path, what, allowed, default in key_rows():
        row = f"| `{path}` | {what} | {allowed} | {default} |"
        assert row in page, f"docs/scenarios.md lacks\n{row}"


@pytest.mark.parametrize("form", ["dict", "path"])
def test_the_environment_of_a_scenario(file, form):
    """It is that of its kind of motion, bit for bit, single and vector."""
    path = file(FERRY)
    scenario = Scenario.of(path)
    given = read_located(path).value if form == "dict" else str(path)
    rows = gymnasium.make_vec("SINS/Scenario-v0", num_envs=3, scenario=given)
    other = gymnasium.make_vec(scenario.env_id, num_envs=3, **scenario.kwargs)
    single = gymnasium.make("SINS/Scenario-v0", scenario=given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(single.unwrapped, skip_render_check=True)
    (obs, _), (twin, _), (alone, _) = rows.reset(seed=5), other.reset(seed=5), single.reset(seed=7)
    for _ in range(4):
        for name, value in obs.items():
            assert_array_equal(value, twin[name])
            assert_array_equal(value[2], alone[name])
        action = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
        obs, twin, alone = rows.step(action)[0], other.step(action)[0], single.step(action[0])[0]


def test_thresholds_that_are_left_out_follow_from_the_bound(file, monkeypatch):
    """Three times the bound at the end, rounded up as in the suite; a recording has none."""
    bound = catalogue.bounds.find(get_task("sway-white-v0"))
    assert thresholds(bound) == {"delta_azimuth_deg": 0.7, "delta_level_arcsec": 70.0}
    text = catalogue.file_of("sway-white-v0").read_text().replace("sway-white-v0", "mine-v0")
    text = "\n".join(line for line in text.splitlines() if not line.startswith(("score", "digest")))
    monkeypatch.setattr(catalogue.bounds, "find", lambda task: bound)
    task = load(file(text))
    assert (task.delta_azimuth_deg, task.delta_level_arcsec, task.hold_s) == (0.7, 70.0, 60.0)
    assert load(file(text.replace("duration_s: 360", "duration_s: 40"))).hold_s == 20.0  # else no run could be aligned
    assert load(file(text + "\nscore: {azimuth_deg: 2}\n")).delta_azimuth_deg == 2
    monkeypatch.undo()
    recorded = file("motion: {kind: recording, file: x.npz}\n")
    with pytest.raises(ValueError, match=r"line 1: score.azimuth_deg and score.level_arcsec are missing"):
        load(recorded)


def test_every_task_can_be_written_as_a_file():
    """The way back from settings to keys, for each task of the suite, and for one that no file can hold."""
    white = get_task("sway-white-v0")
    own = {
        "motion": {"roll": {"amplitude_deg": 3.0}},
        "gps": {"rate_hz": 5, "outages_s": [[3, 5]]},
        "heading_deg": None,
    }
    flown = {"profile": {"segments": [["cruise", 90]], "latitude_deg": 50.0, "longitude_deg": 8.0}}
    tasks = [
        dataclasses.replace(white, name="own-v0", kwargs=own),
        dataclasses.replace(white, name="flown-v0", env_id="SINS/NavFlight-v0", kwargs=flown),
    ]
    for task in (*catalogue.suite_tasks().values(), *tasks):
        assert load(yaml.safe_load(yaml.safe_dump(scenario_of(task)))) == task
    with pytest.raises(ValueError, match="odd-v0: settings that no key of a scenario has"):
        scenario_of(dataclasses.replace(get_task("sway-white-v0"), name="odd-v0", kwargs={"reveal_truth": True}))


def test_a_task_is_registered_by_its_name(file, monkeypatch):
    monkeypatch.setattr(catalogue, "TASKS", dict(catalogue.TASKS))
    path = file(FERRY)
    with pytest.raises(ValueError, match="unknown task 'ferry-v0'"):
        get_task("ferry-v0")
    assert catalogue.named([str(path), "sway-white-v0"]) == ["ferry-v0", "sway-white-v0"]
    assert get_task("ferry-v0") == load(path)
    with pytest.raises(ValueError, match="allowed: a name that no task of the suite has"):
        register(dataclasses.replace(load(path), name="sway-white-v0"))


class Point:
    """An entry point of a package."""

    def __init__(self, name, value):
        self.name, self.value, self.group, self.found = name, "package:x", catalogue.GROUP, value

    def load(self):
        return self.found


def test_tasks_of_other_packages(file, monkeypatch):
    path = file(FERRY)
    points = [Point("ferry-v0", path), Point("boat-v0", lambda: 1 / 0), Point("ship-v0", path)]
    monkeypatch.setattr(
        catalogue.importlib.metadata, "entry_points", lambda group: points if group == "sins_env.tasks" else []
    )
    monkeypatch.setattr(catalogue, "TASKS", dict(catalogue.TASKS))
    assert catalogue.names()[-3:] == ["ferry-v0", "boat-v0", "ship-v0"]
    assert get_task("ferry-v0").delta_level_arcsec == 60
    with pytest.raises(ValueError, match="task boat-v0 of package:x: ZeroDivisionError"):
        get_task("boat-v0")
    with pytest.raises(ValueError, match="task ship-v0 of package:x has the name ferry-v0"):
        get_task("ship-v0")


def test_a_recording_beside_the_file_is_found(file, tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "mine.npz").write_bytes(b"")
    path = file("motion: {kind: recording, file: mine.npz}\nnavigate: true\n", "deep/x.yaml")
    monkeypatch.chdir(tmp_path)
    scenario = Scenario.of(path)
    assert (scenario.kwargs["recording"], scenario.kwargs["mode"]) == (str(tmp_path / "deep" / "mine.npz"), "navigate")
    assert scenario.task["windows"] == 1
