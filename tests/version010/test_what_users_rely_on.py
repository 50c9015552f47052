"""What users of version 0.1.0 rely on: its import paths and names, its commands, and ``EvaluationTask.bound``."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sins_env.cli.grammar import parser
from sins_env.evaluation import get_task
from sins_env.evaluation.bound import bounds

#: Modules that keep their paths, with their public names.
PUBLIC = {
    "sins_env": "GPS_PRESETS IMU_PRESETS Estimator GpsSpec ImuSpec NavState Observation Prior Site Task",
    "sins_env.types": "Array Rng Site NavState Task Observation Estimator",
    "sins_env.specs": """Array Check S G0 DEG ARCSEC DEG_PER_H DEG_PER_SQRT_H UG PPM ImuSpec GpsSpec Prior TOLD_START_STD_DEG
        ANY_HEADING_STD_DEG COARSE_STD_DEG START_VELOCITY_STD_MPS matched_prior thesis_prior PRIORS IMU_PRESETS GPS_PRESETS
        imu_spec gps_spec""",
    "sins_env.earth": """Array Scalar MAX_LATITUDE FREE_AIR GRAVITY_E2 Earth EARTHS get check_latitude radii gravity
        gravity_slope rate_n transport_matrix ecef_to_enu displace offset""",
    "sins_env.attitude": """Array sincos left_matrix right_matrix multiply conjugate normalize TINY from_rotvec rotation_angle
        slerp to_dcm from_dcm from_euler to_euler body_rate body_rate_planes cross_planes davenport wrap skew misalignment_rows
        misalignment_dcm correction_quaternion misalignment_quaternion misalignment_from_dcm misalignment
        misalignment_rate_matrix""",
    "sins_env.recordings": """DATA_VARIABLE FORMATS LAYOUTS Displacements Gap Gnss Layout Recording Reference Summary first_few
        format_of heading_pitch_roll left_out load reference_at resample save seconds summarise to_rfu""",
    "sins_env.evaluation": """TASKS Bound Check Comparison Course EvaluationTask Records Results Summary check_estimator
        compare digest evaluate get_task run_episode""",
    "solvers": "describe make names register settings",
    "solvers.types": "Array Function Gaussian Linear Transition NoiseLaw MISSING Measurement Moments Innovation Health Filter",
    "solvers.filters": "FILTERS make_filter names register",
    "solvers.smoothing": "Steps Smoothed smooth fixed_lag",
}
#: What each verb took.
COMMANDS = """
list
describe name --allan --plot
run task solver --run --plot --traceback --seed --set --timeout
eval --task --solver --runs --executor --workers --chunk --resume --plot --seed --set --timeout --db
board --task --solver --md --csv --json --plot --db
report --html --task --solver --db
compare task solver reference --score --db
export --csv --json --parquet --task --solver --db
verify --rows --seed --draw --workers --task --solver --db
reproduce table --runs --quick --out --workers
suite-hash --seed
check solver --set
replay recording solver --window --stride --mode --coarse --epoch --imu --outage --seed --set --plot
convert source target --format --to --mapping --axes --resample --drop-duplicates --velocity-from-positions --force
bench solver --task --runs
"""
_IMPORT_ALL = """
import importlib, json, sys, warnings
found = {}
for name in sys.stdin.read().split():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        importlib.import_module(name)
    found[name] = [f"{one.category.__name__}: {one.message}" for one in caught]
print(json.dumps(found))
"""
_NAMES = """
import importlib, json, sys
for module, names in json.load(sys.stdin).items():
    for name in names.split():
        getattr(importlib.import_module(module), name)
"""


def fresh(code, given, *options):
    """Standard output of a new interpreter that reads ``given``."""
    line = [sys.executable, *options, "-c", code]
    done = subprocess.run(line, input=given, capture_output=True, text=True, timeout=300, cwd="/")
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_public_names_are_there_without_a_warning():
    fresh(_NAMES, json.dumps(PUBLIC), "-W", "error")


def test_every_other_module_warns_once_where_it_has_moved(request):
    modules = Path(__file__).with_name("modules.txt").read_text().split()
    assert set(PUBLIC) < set(modules)
    found = json.loads(fresh(_IMPORT_ALL, "\n".join(modules)))
    root = request.config.rootpath
    for name, warned in found.items():
        place = root.joinpath(*name.split("."))
        if place.is_dir() or place.with_suffix(".py").is_file():
            assert warned == [], name
        else:
            (text,) = warned
            assert text.startswith(f"DeprecationWarning: {name} has moved to "), name
            assert text.endswith("; the old name ends with version 0.3"), name


@pytest.mark.parametrize("line", COMMANDS.strip().splitlines())
def test_commands_take_what_they_took(line):
    verb, *words = line.split()
    actions = parser().verbs[verb]._actions
    taken = {name for action in actions for name in action.option_strings or [action.dest]}
    assert set(words) <= taken
    needed = {action.dest for action in actions if not action.option_strings and action.nargs not in ("?", "*")}
    assert needed <= set(words)


def test_the_old_way_to_the_bound():
    task = get_task("flight-lu-gauss-v0")
    with pytest.warns(DeprecationWarning, match=r"EvaluationTask.bound\(\) has moved to .*bounds.find\(task\)"):
        assert task.bound() is bounds.find(task)
