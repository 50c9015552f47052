"""The other packages, and their own virtual environment. This module needs the standard library only."""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / ".venv-peers"
PYTHON = FOLDER / ("Scripts" if sys.platform == "win32" else "bin") / "python"


@dataclass(frozen=True)
class Peer:
    """Another package."""

    distribution: str = ""  #: its name on the package index
    needs: tuple[str, ...] = ()  #: packages that it needs but does not install
    module: str = ""  #: module in this folder with its entries
    absent: str = ""  #: why it cannot be measured


PEERS = {
    "filterpy": Peer("filterpy", module="on_filterpy"),
    "Stone Soup": Peer("stonesoup", module="on_stonesoup"),
    "pyins": Peer("python-ins", module="on_pyins"),
    "PSINS": Peer(absent="a MATLAB toolbox: it does not run in Python"),
    "kalman-py": Peer("kalman-py", ("jax",), "on_kalman_py"),
    "dynamax": Peer("dynamax", ("jax",), "on_dynamax"),
}


def prepare() -> None:
    """Make the environment and install what it lacks; a package that cannot be installed is named in one line.

    Raises:
        SystemExit: sins_env itself cannot be installed.
    """
    if not PYTHON.exists():
        print(f"making {FOLDER.name}", flush=True)
        venv.create(FOLDER, with_pip=True)
    have = installed()
    if "sins-env" not in have and (reason := install("--editable", str(ROOT))):
        raise SystemExit(f"sins_env could not be installed in {FOLDER}: {reason}")
    for name, peer in PEERS.items():
        wanted = {peer.distribution, *peer.needs} - {""}
        if not wanted <= have:
            print(f"installing {name}", flush=True)
            if reason := install(*sorted(wanted)):
                print(f"{name} could not be installed: {reason}", flush=True)


def installed() -> set[str]:
    """Return the names of the distributions in the environment."""
    ask = [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "list", "--format=json"]
    done = subprocess.run(ask, capture_output=True, text=True, check=True)
    return {str(each["name"]).lower() for each in json.loads(done.stdout)}


def install(*what: str) -> str:
    """Install distributions, and return why that failed; an empty text means that it did not."""
    done = subprocess.run(
        [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "install", "--quiet", *what],
        capture_output=True,
        text=True,
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
    return "" if done.returncode == 0 else (lines[-1] if lines else f"pip ended with {done.returncode}")
