"""Verbs of the command line, with their options and exit codes.

Each verb names its function as ``module:name``, so that only the modules of that verb are imported.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from sins_env import __version__
from sins_env.cli.arguments import Parser, count, executor, moment, number, positive, seed, setting, settings, several
from sins_env.recordings import FORMATS, REFUSING

DEFAULT_DB = "results.sqlite"
CODES = (
    "First: sins-env run sway-white-v0 ckf --plot run.png; sins-env VERB --help says more. "
    "Exit code: 0, 1 for a failed run, 2 for wrong use, 130 for Ctrl-C."
)
_FAILED = "failed epochs (an action that is not finite, or zero). A run that diverged is a result: 0."
_RUN_CODES = f"Exit code 1: the run raised, was lost, was given up by the solver, or had {_FAILED}"
_START = "start (s on the recording's clock, +S from its start, or a date) and length"
_FORMATS = f"Formats: {', '.join(map(str, FORMATS.values()))}."
_MAP = (
    "What cannot be measured is left open, with what to write. Then: sins-env describe FILE, and sins-env replay FILE SOLVER. "
    "docs/recordings.md has every key."
)
WRITTEN = tuple(name for name, format in FORMATS.items() if format.save)
_EVAL_CODES = (
    f"Exit code 1: any run raised, was lost, or had {_FAILED} Runs given up by the solver are counted in the table."
)
_TASK = "a name (sins-env list shows them), or the YAML or JSON file of a scenario (docs/scenarios.md)"
_SOLVER = "a name (sins-env list shows them), or module:Factory: a class in module.py of this folder"
_SETTING = "a setting of the solver (sins-env describe SOLVER shows them); may be repeated"
_CONTRACT = (
    "An estimator has batched = False, or True if it takes a leading run axis; reset(task, rng, num_runs=1); and step(obs), "
    "which returns q_nb (4), or in navigation q_nb, v_n and position (10). sins-env describe SINS/AlignSway-v0 shows what obs "
    "holds; sins_env.types.Task is the task. Optional: covariance()."
)
_SPEC = "a preset, a JSON or YAML file, or NAME=VALUE,...: navigation,arw_deg_sqrt_h=0.002"
_SEED = "seed of the suite (default: the task's own); - reads a secret one from standard input"
_SUITE = (
    "A hidden suite: draw a seed of at least 64 bits (python -c 'import secrets; print(secrets.randbits(128))'), publish "
    "its hash, evaluate with --seed -, and publish the seed in the end. Results files hold the first 16 digits only."
)
_VERIFY_CODES = (
    "Exit code 1: a run differs, or none could be run again. What only the file names is never imported, for it may be a "
    "stranger's: a solver by name must be installed, and a module:Factory must be named with --solver."
)
_ADOPT = (
    "rows of an older version of the code count as made by the present one if the rows that are run again, at least one of "
    "each solver and task, are equal; the file keeps who, when, which versions and how many rows"
)
_SUBMIT_CODES = (
    "The bundle has the rows, the solver's name and Python files with their hashes, provenance and the board. Checked before: "
    "no run is missing, and random rows give the same scores again. Exit code 1: they do not, and nothing is written."
)
_JUDGE_CODES = (
    "Nothing of the bundle is imported or run. Play the solver on the hidden suite in the folder that --out makes: sins-env "
    "eval --solver MODULE:FACTORY --seed - --db HIDDEN; then --db HIDDEN shows both. docs/contest.md has every step."
)
_MERGE_CODES = (
    "A run that several files have is there once. Exit code 1: runs of one key that differ, or a task with other criteria, "
    "definition, world or bound; each is named, and nothing is written. Other code and other versions of a task are told."
)
_SOLUTION_CODES = (
    "The solution is held against itself: innovations, their correlation, and withheld fixes. What leaves its band is a warning "
    'and "consistent": false in JSON, with exit code 0. Exit code 1: the solver raised or gave up.'
)
_TABLES = (
    "What is printed, ours with its 95 % interval, and a verdict. Runs are kept in DIR/results.sqlite and made once; an "
    "interrupted command goes on where it was."
)
_BOUND = (
    "The Cramer-Rao bound: no estimator without knowledge of the motion has smaller errors. Shares are those of the variance under "
    "the optimal gain, and add up to 100 %. An accuracy is 0.1deg (azimuth), 0.05m/s, 2m, or level=20arcsec, height=1m."
)
_DATASET = (
    "Arrays have an axis for runs and one for epochs: docs/learning.md lists them. The file appears whole or not at all, and the "
    "same command makes the same bits."
)
_LIST = "Without KIND, what there is by name on one screen."

#: Function that adds a verb. It takes the name, the function as ``module:name``, the help text, and a text below the options.
Verb = Callable[..., argparse.ArgumentParser]


def parser() -> Parser:
    """Return the parser of all verbs. The default ``go`` of a verb is its function, as ``module:name`` of this folder."""
    about = "Which filter aligns a strapdown inertial system fastest?"
    top = Parser(prog="sins-env", description=about, epilog=CODES)
    top.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    verbs = top.add_subparsers(dest="verb", metavar="VERB", parser_class=Parser, required=True)
    top.verbs = verbs.choices

    def verb(name: str, go: str, text: str, epilog: str | None = None) -> argparse.ArgumentParser:
        sub = verbs.add_parser(name, help=text, description=text, epilog=epilog)
        sub.set_defaults(go=go)
        return sub

    _look(verb)
    _play(verb)
    _read_results(verb)
    _publish(verb)
    _hold_against(verb)
    _solve(verb)
    _learn(verb)
    return top


def _look(verb: Verb) -> None:
    """Add the verbs that list and describe environments, tasks, solvers and files."""
    sub = verb(
        "list", "describe.listing:list_kinds", "names: all of them, or those of one kind with what they are", _LIST
    )
    sub.add_argument("kind", nargs="?", metavar="KIND", help="environments, tasks, solvers, flights, tables or presets")

    text = "what is known of an environment, task, solver, preset, flight or recording"
    sub = verb("describe", "describe.named:describe", text)
    text = "one that sins-env list shows, module:Factory, or a file; scenario: every key of a scenario"
    sub.add_argument("name", metavar="NAME", help=text)
    sub.add_argument("--yaml", action="store_true", help="print a task as the file of a scenario, to copy and change")
    sub.add_argument("--imu", metavar="SPEC", help=f"errors of a recording's IMU, for its first heading: {_SPEC}")
    sub.add_argument("--allan", metavar="FILE", help="draw the Allan deviation of an IMU preset or a recording")
    sub.add_argument("--plot", metavar="FILE", help="draw a flight: a profile by name, or a YAML or JSON file")

    text = "before a trip: the best that the sensors allow over time, and what limits it"
    sub = verb("bound", "verbs.bound:bound", text, _BOUND)
    sub.add_argument("task", metavar="TASK", help=_TASK)
    text = "wanted accuracies: when they are reached, or what the bound tends to"
    several(sub, "--until", help=text)
    text = "the same with other settings, such as gps.rate_hz=1,5,10 or imu=navigation,tactical; may be repeated"
    sub.add_argument("--compare", type=settings, action="append", default=[], metavar="NAME=VALUES", help=text)
    sub.add_argument("--at", type=positive, metavar="S", help="time of the budget (default: the end)")
    sub.add_argument("--json", action="store_true", help="all of it as JSON")
    sub.add_argument("--plot", metavar="FILE", help="draw errors over time, and the shares of the sources of error")


def _play(verb: Verb) -> None:
    """Add the verbs that run solvers on tasks."""
    sub = verb("run", "verbs.run:run", "one episode, with its final errors and a figure", _RUN_CODES)
    sub.add_argument("task", metavar="TASK", help=_TASK)
    sub.add_argument("solver", metavar="SOLVER", help=_SOLVER)
    sub.add_argument("--run", type=number, default=0, metavar="N", help="which run of the suite (default 0)")
    sub.add_argument("--plot", metavar="FILE", help="draw the errors over time")
    sub.add_argument("--traceback", action="store_true", help="show where the solver raised")
    _add_suite(sub)

    sub = verb("eval", "verbs.evaluate:evaluate", "many runs of solvers on tasks, into a results file", _EVAL_CODES)
    several(sub, "--task", required=True, help="names (sins-env list shows them), or files of scenarios")
    several(sub, "--solver", required=True, help=_SOLVER)
    sub.add_argument("--runs", type=count, default=100, metavar="N", help="default 100; a recording has its windows")
    text = "processes (default), dask, or tcp://HOST:PORT: a Dask scheduler that runs elsewhere (docs/scale.md)"
    sub.add_argument("--executor", type=executor, default="processes", metavar="NAME", help=text)
    _add_workers(sub)
    sub.add_argument("--chunk", type=count, metavar="N", help="runs per batch (default 64 to 256)")
    sub.add_argument("--resume", action="store_true", help="keep the runs that are there, make those that are missing")
    sub.add_argument("--plot", metavar="FILE", help="draw errors over time and success against the threshold")
    _add_suite(sub)
    _add_db(sub)


def _read_results(verb: Verb) -> None:
    """Add the verbs that read a results file."""
    sub = verb("board", "verbs.results_file:board", "the ranked table of a results file")
    _add_choice(sub)
    form = sub.add_mutually_exclusive_group()
    for name, kind in (("md", "Markdown"), ("csv", "CSV"), ("json", "JSON")):
        text = f"as {kind}, with all columns"
        form.add_argument(f"--{name}", dest="form", action="store_const", const=name, help=text)
    sub.add_argument("--plot", metavar="FILE", help="draw errors over time and success against the threshold")

    text = "the results of a file as one HTML page: tables, figures, failures, provenance"
    sub = verb("report", "verbs.results_file:report", text)
    sub.add_argument("--html", required=True, metavar="FILE", help="where to write it")
    _add_choice(sub)

    text = "two solvers on the same runs: ratio of RMS, success and time, with intervals"
    sub = verb("compare", "verbs.results_file:compare", text)
    sub.add_argument("task", metavar="TASK", help="one that the file holds, or the file of its scenario")
    sub.add_argument("solver", metavar="SOLVER", help="as it is called in the file")
    sub.add_argument("reference", metavar="SOLVER", help="solver to compare it with")
    text = "what errors are compared in: azimuth, level ...; of navigation position, velocity ... (default: what ranks)"
    sub.add_argument("--score", metavar="NAME", help=text)
    _add_db(sub)

    sub = verb("export", "verbs.results_file:export", "every run of a results file with all its scores")
    form = sub.add_mutually_exclusive_group(required=True)
    for name in ("csv", "json", "parquet"):
        form.add_argument(f"--{name}", metavar="FILE")
    _add_choice(sub)

    sub = verb(
        "verify", "verbs.results_file:verify", "run random rows of a results file again and compare", _VERIFY_CODES
    )
    text = "how many, spread over solvers and tasks (default 20, with --adopt 200)"
    sub.add_argument("--rows", type=count, metavar="N", help=text)
    sub.add_argument("--seed", type=seed, metavar="N", help=_SEED)
    _add_draw(sub)
    sub.add_argument("--adopt", action="store_true", help=_ADOPT)
    _add_workers(sub)
    _add_choice(sub)

    sub = verb("merge", "verbs.results_file:merge", "the runs of several results files in a new one", _MERGE_CODES)
    sub.add_argument("file", nargs="+", metavar="FILE", help="results files, of other machines perhaps")
    text = f"the new results file (default {DEFAULT_DB})"
    sub.add_argument("--db", default=DEFAULT_DB, metavar="FILE", help=text)


def _publish(verb: Verb) -> None:
    """Add the verbs for publications: reproduced tables, and the hash of a suite that stays secret for a time."""
    sub = verb("reproduce", "verbs.reproduce:reproduce", "published tables as Monte Carlo runs", _TABLES)
    text = "their numbers, as sins-env list tables shows them (default: all)"
    sub.add_argument("table", nargs="*", metavar="TABLE", help=text)
    sub.add_argument("--runs", type=count, metavar="N", help="runs of every line (default: each table's own number)")
    sub.add_argument("--quick", action="store_true", help="few runs, for a first look")
    sub.add_argument("--out", default="reproduction", metavar="DIR", help="for REPRODUCTION.md and the runs")
    _add_workers(sub)

    sub = verb("submit", "verbs.contest:submit", "a bundle of a solver's rows for the holder of a board", _SUBMIT_CODES)
    sub.add_argument("file", metavar="FILE", help="results file, made without --seed")
    sub.add_argument("solver", metavar="SOLVER", help="as it is called in the file; it is run again, and so imported")
    several(sub, "--task", help="these tasks only")
    sub.add_argument("--rows", type=count, default=20, metavar="N", help="rows to run again (default 20)")
    _add_draw(sub)
    sub.add_argument("--out", default="submission.zip", metavar="FILE", help="the bundle (default submission.zip)")
    _add_settings(sub)
    _add_workers(sub)

    sub = verb("judge", "verbs.contest:judge", "a bundle: what it claims, beside a hidden suite", _JUDGE_CODES)
    sub.add_argument("bundle", metavar="BUNDLE", help="what sins-env submit has written, of a stranger perhaps")
    sub.add_argument("--out", metavar="DIR", help="new folder for the rows and the Python files of the solver")
    sub.add_argument("--db", metavar="FILE", help="results file of the hidden suite, to show both")

    sub = verb(
        "suite-hash", "verbs.results_file:suite", "the hash of a secret suite seed, to be published first", _SUITE
    )
    sub.add_argument("--seed", type=seed, default="-", metavar="N", help="default: - reads it from standard input")


def _hold_against(verb: Verb) -> None:
    """Add the verbs for solvers and recordings of one's own: contract, replay, conversion and speed."""
    sub = verb("check", "verbs.check:check", "check that an estimator keeps the contract", _CONTRACT)
    sub.add_argument("solver", metavar="SOLVER", help=_SOLVER)
    text = "how far results that ought to be the same may be apart (default 1e-9; float32 needs about 1e-6)"
    sub.add_argument("--tolerance", type=positive, metavar="X", help=text)
    _add_settings(sub)
    _add_timeout(sub)

    text = "a solver on windows of any recording: heading, pitch, roll and their spread"
    sub = verb("replay", "verbs.recordings:replay", text)
    sub.add_argument("recording", metavar="FILE", help="of any format, or the mapping (.json) of one")
    sub.add_argument("solver", metavar="SOLVER", help=_SOLVER)
    text = f"{_START} (default: all of it, or the longest part without a gap); may be repeated"
    _add_spans(sub, "--window", ("START", "LENGTH"), text, moment)
    sub.add_argument("--stride", type=float, metavar="S", help="as many windows as fit, each so much later")
    sub.add_argument("--mode", metavar="NAME", help="align (default), or navigate: velocity and position too")
    sub.add_argument("--coarse", type=float, metavar="S", help="coarse phase (default 90 s, 60 s to navigate)")
    _add_played(sub, "withhold the fixes of these seconds of the window; may be repeated")
    sub.add_argument("--seed", type=seed, default=0, metavar="N", help="seed of solvers that draw (default 0)")
    _add_settings(sub)
    _add_timeout(sub)
    _add_out(sub)
    sub.add_argument("--plot", metavar="FILE", help="draw heading, pitch, roll and their spread")

    sub = verb("convert", "verbs.recordings:convert", "a recording in another format", _FORMATS)
    sub.add_argument("source", metavar="IN")
    sub.add_argument("target", metavar="OUT")
    text = f"format of IN, if its ending does not tell: {', '.join(FORMATS)}"
    sub.add_argument("--format", metavar="NAME", help=text)
    sub.add_argument("--to", metavar="NAME", help="format of OUT, likewise: " + ", ".join(WRITTEN))
    sub.add_argument("--mapping", metavar="FILE", help="description of what IN lacks, as JSON (default: IN's .json)")
    sub.add_argument("--axes", metavar="AXES", help="where x, y, z of IN point: FRD, RFU, FLU ... or +y+x-z")
    sub.add_argument("--resample", type=float, metavar="HZ", help="to another rate; never done unasked")
    sub.add_argument("--drop-duplicates", action="store_true", help="keep the first of samples with one stamp")
    sub.add_argument("--velocity-from-positions", action="store_true", help="for fixes without velocities")
    _add_accept(sub)
    sub.add_argument("--force", action="store_true", help="overwrite OUT")

    text = "a first mapping of a text table: delimiter, columns, units and axes, each with the measure behind it"
    sub = verb("map", "verbs.mapping:write_mapping", text, _MAP)
    sub.add_argument("file", metavar="FILE", help="a table with gyros and accelerometers")
    sub.add_argument("--out", metavar="FILE", help="the mapping (default: FILE's name with .json, where it is found)")
    sub.add_argument(
        "--site", type=float, nargs=3, metavar=("LAT", "LON", "H"), help="deg, deg, m, if there are no fixes"
    )
    sub.add_argument(
        "--axes", metavar="AXES", help="where x, y, z point: FRD, RFU, FLU ...; measured if the file tells"
    )
    sub.add_argument("--rate", type=positive, metavar="HZ", help="rate of a file without times")
    sub.add_argument(
        "--gnss", metavar="FILE", help="fixes in a file of their own beside it: a table, or a .pos of RTKLIB"
    )
    sub.add_argument("--force", action="store_true", help="overwrite the mapping")

    text = "the noise of an IMU, fitted to data at rest: a table, a figure, and a file that --imu takes"
    sub = verb("allan", "verbs.allan:allan", text)
    sub.add_argument("file", metavar="FILE", help="a recording at rest, or with a rest of a minute or more")
    text = f"{_START} (default: the longest rest)"
    sub.add_argument("--window", type=moment, nargs=2, metavar=("START", "LENGTH"), help=text)
    text = "shortest averaging time of the fit, s: leaves out the vibration of the base"
    sub.add_argument("--from", dest="least", type=positive, default=0.0, metavar="S", help=text)
    sub.add_argument("--imu", metavar="SPEC", help=f"what does not show at rest, such as scale factors: {_SPEC}")
    sub.add_argument("--out", metavar="FILE", help="write the specification, .yaml or .json")
    sub.add_argument("--kalibr", metavar="FILE", help="write an IMU file of Kalibr")
    sub.add_argument("--plot", metavar="FILE", help="draw the Allan deviations beside the specification")
    _add_accept(sub)

    sub = verb("bench", "verbs.bench:bench", "speed of the whole chain and of its parts")
    sub.add_argument("solver", metavar="SOLVER", nargs="?", default="ckf", help=f"{_SOLVER} (default ckf)")
    sub.add_argument("--task", default="sway-white-v0", metavar="NAME", help="default sway-white-v0")
    sub.add_argument("--runs", type=count, nargs="+", default=[256, 1], metavar="N", help="batch sizes (default 256 1)")
    sub.add_argument("--json", action="store_true", help="as JSON, with the versions of what was measured")
    _add_timeout(sub)

    text = "compile the kernels beforehand, which otherwise happens when each is used first"
    verb("warm", "verbs.bench:warm", text)


def _solve(verb: Verb) -> None:
    """Add the verbs that make a solution of a recording."""
    text = "a recording navigated: position, velocity, attitude and biases with their sigmas, as files"
    sub = verb("navigate", "verbs.solutions:navigate", text, _SOLUTION_CODES)
    _add_solution(sub)
    text = "take every state from all fixes, by a smoother; the solver must have one, as inekf has"
    sub.add_argument("--smooth", action="store_true", help=text)

    text = "heading, pitch and roll of a base at rest with their sigmas, and how they converged"
    _add_solution(verb("align", "verbs.solutions:align", text, _SOLUTION_CODES))


def _learn(verb: Verb) -> None:
    """Add the verb that writes data sets."""
    text = "observations and truth of simulated runs to learn from, which no suite can have"
    sub = verb("dataset", "verbs.dataset:dataset", text, _DATASET)
    sub.add_argument("task", metavar="TASK", help=_TASK)
    sub.add_argument("--runs", type=count, required=True, metavar="N", help="number of runs")
    text = "a file that ends in .npz, or minari:ID for a local dataset of Minari"
    sub.add_argument("--out", required=True, metavar="FILE", help=text)
    sub.add_argument("--seed", type=number, default=0, metavar="N", help="seed of the data set (default 0)")
    text = "increments of an epoch, sums of neighbours (default: all of the task)"
    sub.add_argument("--samples", type=count, metavar="N", help=text)
    text = "parts of train, validation and test (default 8 1 1)"
    sub.add_argument("--splits", type=number, nargs=3, default=[8, 1, 1], metavar=("A", "B", "C"), help=text)


def _add_played(sub: argparse.ArgumentParser, outage: str) -> None:
    """Add how a recording is played: epochs, gaps, sensors, fixes that are withheld, and findings that are accepted."""
    sub.add_argument("--epoch", type=float, metavar="S", help="navigation epoch (default 0.1 s)")
    _add_bridge(sub)
    _add_sensors(sub)
    _add_spans(sub, "--outage", ("START", "END"), outage)
    _add_accept(sub)


def _add_solution(sub: argparse.ArgumentParser) -> None:
    """Add the options of a verb that makes a solution."""
    sub.add_argument("recording", metavar="FILE", help="of any format, or the mapping (.json) of one")
    sub.add_argument("--solver", metavar="SOLVER", help=f"{_SOLVER} (default: the recommended one)")
    text = f"{_START} (default: all of it, or the longest part without a gap)"
    sub.add_argument("--window", type=moment, nargs=2, metavar=("START", "LENGTH"), help=text)
    text = "coarse phase, at rest (default 0 with the recommended solver, else that of replay)"
    sub.add_argument("--coarse", type=float, metavar="S", help=text)
    _add_played(
        sub, "withhold the fixes of these seconds of the window, and judge the solution by them; may be repeated"
    )
    _add_out(sub)
    sub.add_argument("--figure", metavar="FILE", help="draw track or angles, innovations in their band, and sigmas")
    sub.add_argument("--json", action="store_true", help="the summary as JSON, with what was found")
    sub.add_argument("--seed", type=seed, default=0, metavar="N", help="seed of solvers that draw (default 0)")
    _add_settings(sub)
    _add_timeout(sub)


def _add_out(sub: argparse.ArgumentParser) -> None:
    """Add the options of files of a solution."""
    text = "write the solution: .csv, .kml (map), .tum (evo), .nav (KF-GINS) or .npz; may be repeated"
    sub.add_argument("--out", action="append", default=[], metavar="FILE", help=text)
    text = "rate of the files, of the nearest epochs (default: every epoch)"
    sub.add_argument("--rate", type=positive, metavar="HZ", help=text)
    text = "enu (default), or ned: North-East-Down, with a Forward-Right-Down body"
    sub.add_argument("--frame", default="enu", choices=("enu", "ned"), help=text)


def _add_settings(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--set", type=setting, action="append", default=[], metavar="NAME=VALUE", help=_SETTING)


def _add_sensors(sub: argparse.ArgumentParser) -> None:
    """Add the options that tell a solver of the sensors (:mod:`sins_env.cli.verbs.sensors`)."""
    sub.add_argument("--imu", metavar="SPEC", help=f"errors of the IMU (default rlg-car): {_SPEC}")
    sub.add_argument(
        "--gps", metavar="SPEC", help="errors of the fixes, likewise (default: the receiver's own, or dgps)"
    )
    text = "errors of a sensor in the recording: odometer, odometer:calibrated, dvl:noise_mps=0.02, height:off; may be repeated"
    sub.add_argument("--aid", action="append", default=[], metavar="NAME[:SPEC]", help=text)
    text = "standard deviations in the file: factor=2,pos_floor_m=0.05,vel_floor_mps=0.02 (default: as they are, at least 0.01)"
    sub.add_argument("--fix-std", metavar="SETTINGS", help=text)


def _add_accept(sub: argparse.ArgumentParser) -> None:
    text = "take the recording although this was found (sins-env describe FILE shows what is); may be repeated"
    sub.add_argument("--accept", action="append", default=[], choices=REFUSING, metavar="NAME", help=text)


def _add_suite(sub: argparse.ArgumentParser) -> None:
    """Add the options of verbs that run a suite."""
    sub.add_argument("--seed", type=seed, metavar="N", help=_SEED)
    _add_settings(sub)
    _add_timeout(sub)


def _add_timeout(sub: argparse.ArgumentParser) -> None:
    text = (
        "a run has failed if one call of the solver takes longer, s (default: 10, first 60; this project's own: none)"
    )
    sub.add_argument("--timeout", type=positive, metavar="S", help=text)


def _add_draw(sub: argparse.ArgumentParser) -> None:
    text = "seed of the choice of rows (default: another each time)"
    sub.add_argument("--draw", type=number, metavar="N", help=text)


def _add_workers(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--workers", type=count, metavar="N", help="default: one per core")


def _add_db(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--db", default=DEFAULT_DB, metavar="FILE", help=f"results file (default {DEFAULT_DB})")


def _add_choice(sub: argparse.ArgumentParser) -> None:
    """Add the options of verbs that read all or some results of a file."""
    several(sub, "--task", help="these tasks only; names, or files of scenarios")
    several(sub, "--solver", help="these solvers only")
    _add_db(sub)


def _add_bridge(sub: argparse.ArgumentParser) -> None:
    text = "fill gaps between samples of up to so many seconds with interpolated increments (default 0.1)"
    sub.add_argument("--bridge", type=float, metavar="S", help=text)


def _add_spans(sub: argparse.ArgumentParser, flag: str, names: tuple[str, str], text: str, kind: Any = float) -> None:
    sub.add_argument(flag, type=kind, nargs=2, action="append", default=[], metavar=names, help=text)
