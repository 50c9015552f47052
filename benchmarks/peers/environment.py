"""The other packages, and a virtual environment of their own, beside the project's. Standard library only."""

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
    distribution: str = ""  #: its name in the registry
    needs: tuple[str, ...] = ()  #: what it does not install itself
    module: str = ""  #: of its entries, in this folder
    absent: str = ""  #: why it cannot be measured at all


PEERS = {
    "filterpy": Peer("filterpy", module="on_filterpy"),
    "Stone Soup": Peer("stonesoup", module="on_stonesoup"),
    "pyins": Peer("python-ins", module="on_pyins"),
    "PSINS": Peer(absent="a MATLAB toolbox: it does not run in Python"),
    "kalman-py": Peer("kalman-py", ("jax",), "on_kalman_py"),
    "dynamax": Peer("dynamax", ("jax",), "on_dynamax"),
}


def prepare() -> None:
    """Makes the environment and installs what is missing in it; what cannot be installed is said in one line.

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
    """Names of the distributions in the environment."""
    ask = [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "list", "--format=json"]
    done = subprocess.run(ask, capture_output=True, text=True, check=True)
    return {str(each["name"]).lower() for each in json.loads(done.stdout)}


def install(*what: str) -> str:
    """Empty, or why it failed."""
    done = subprocess.run(
        [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "install", "--quiet", *what],
        capture_output=True,
        text=True,
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
    return "" if done.returncode == 0 else (lines[-1] if lines else f"pip ended with {done.returncode}")
