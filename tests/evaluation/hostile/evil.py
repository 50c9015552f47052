"""Solvers that do harm, each in one step of its own unless it says otherwise; they import nothing of the evaluation.

Most are those of the cases that strangers sent. The honest part is the told start, for ever.
"""

import ctypes
import fcntl
import gc
import os
import random
import resource
import signal
import stat
import struct
import subprocess
import sys
import threading
import time

import numpy as np


class Honest:
    batched = False
    at = 5

    def reset(self, task, rng, num_runs=1):
        self.k, self.task = 0, task
        self.q = np.array(task.start.q_nb)

    def step(self, obs):
        self.k += 1
        if self.k == self.at:
            found = self.evil(obs)
            if found is not None:
                return found
        return self.q.copy()

    def evil(self, obs):
        return None


# ---- what it raises


class Raises(Honest):
    def evil(self, obs):
        raise RuntimeError("boom \x1b[31m<script>alert(1)</script>")


class RaisesStrBomb(Honest):
    def evil(self, obs):
        class E(Exception):
            def __str__(self):
                raise RuntimeError("no str for you")

        raise E


class RaisesStrExit(Honest):
    def evil(self, obs):
        class E(Exception):
            def __str__(self):
                sys.exit()

        raise E


class RaisesHuge(Honest):
    def evil(self, obs):
        raise RuntimeError("x" * 50_000_000)


class Interrupts(Honest):
    def evil(self, obs):
        raise KeyboardInterrupt


class Exits(Honest):
    def evil(self, obs):
        sys.exit(0)


class Group(Honest):
    def evil(self, obs):
        raise BaseExceptionGroup("both", [KeyboardInterrupt(), SystemExit(1)])


class DeepGroup(Honest):
    def evil(self, obs):
        deep = ValueError("the last")
        for _ in range(5000):
            deep = ExceptionGroup("deep", [deep])
        raise deep


class LongName(Honest):
    def evil(self, obs):
        raise type("N" * 10**6, (Exception,), {})


class Unicode(Honest):
    def evil(self, obs):
        raise RuntimeError("\ud800 \u202e \x00 \n\n second line")


class Recurses(Honest):
    def evil(self, obs):
        sys.setrecursionlimit(10**9)

        def f():
            return f() + 1

        f()


# ---- how it ends or hangs


class OsExits(Honest):
    def evil(self, obs):
        os._exit(0)


class Crashes(Honest):
    def evil(self, obs):
        ctypes.string_at(0)


class LoopsInPython(Honest):
    def evil(self, obs):
        while True:
            pass


class LoopsInC(Honest):
    def evil(self, obs):
        sum(range(10**13))


class Sleeps(Honest):
    def evil(self, obs):
        time.sleep(10**6)


class IgnoresSignals(Honest):
    def evil(self, obs):
        for number in range(1, 32):
            if number not in (signal.SIGKILL, signal.SIGSTOP):
                signal.signal(number, signal.SIG_IGN)
        while True:
            time.sleep(1)


class Stops(Honest):
    def evil(self, obs):
        os.kill(os.getpid(), signal.SIGSTOP)


class HangsAtExit(Honest):
    def evil(self, obs):
        threading.Thread(target=time.sleep, args=(10**6,)).start()
        raise RuntimeError("with a thread that does not end")


# ---- processes and threads


class Forks(Honest):
    def evil(self, obs):
        if os.fork() == 0:
            time.sleep(10**6)


class ForksAndReturns(Honest):
    def evil(self, obs):
        os.fork()


class ForksAndLeaves(Honest):
    """Its child holds all its files open."""

    def evil(self, obs):
        if os.fork() == 0:
            time.sleep(10**6)
        os._exit(4)


class ForksAway(Honest):
    """A grandchild in a session of its own."""

    def evil(self, obs):
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                time.sleep(10**6)
            os._exit(0)


class StartsPrograms(Honest):
    def evil(self, obs):
        subprocess.Popen(["sleep", "1000000"], start_new_session=True)


class Threads(Honest):
    def evil(self, obs):
        def f():
            while True:
                time.sleep(0)

        for _ in range(3):
            threading.Thread(target=f, daemon=True).start()


class KillsParent(Honest):
    def evil(self, obs):
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(10**6)


class KillsGroup(Honest):
    def evil(self, obs):
        os.kill(0, signal.SIGTERM)
        time.sleep(10**6)


class KillsStarter(Honest):
    """The process that starts those of solvers; it starts anew."""

    def evil(self, obs):
        with open(f"/proc/{os.getppid()}/stat") as file:
            os.kill(int(file.read().rpartition(")")[2].split()[1]), signal.SIGKILL)


class StopsKeeper(Honest):
    def evil(self, obs):
        os.kill(os.getppid(), signal.SIGSTOP)


class StopsStarter(Honest):
    def evil(self, obs):
        with open(f"/proc/{os.getppid()}/stat") as file:
            os.kill(int(file.read().rpartition(")")[2].split()[1]), signal.SIGSTOP)


# ---- memory, files, output


class Allocates(Honest):
    def evil(self, obs):
        kept = []
        while True:
            kept.append(np.empty(10**8))


class RaisesItsLimit(Honest):
    def evil(self, obs):
        resource.setrlimit(resource.RLIMIT_AS, (-1, -1))
        kept = []
        while len(kept) < 200:
            kept.append(np.empty(10**7))


class Prints(Honest):
    def evil(self, obs):
        print("\x1b[31mA\u202e")
        for _ in range(200):
            print("A" * 10000)
        sys.stderr.write("B" * 1000000)


class ClosesStandard(Honest):
    def evil(self, obs):
        for file in (0, 1, 2):
            os.close(file)


class ClosesAll(Honest):
    def evil(self, obs):
        os.closerange(0, 256)


class Leaves(Honest):
    def evil(self, obs):
        os.environ.clear()
        os.environ["SINS_ENV_DATA"] = "/nowhere"
        os.chdir("/")
        os.umask(0o777)
        random.seed(0)
        np.random.seed(0)  # noqa: NPY002


# ---- what it returns


class Returns(Honest):
    def __init__(self, what="none"):
        self.what = what

    def evil(self, obs):
        class Bomb:
            def __float__(self):
                os._exit(3)

        class Interrupting:
            def __array__(self, *arguments, **settings):
                raise KeyboardInterrupt

        class Sub(np.ndarray):
            """One whose pickle runs code where it is read."""

            def __reduce__(self):
                return os._exit, (1,)

        return {
            "nan": lambda: np.full(4, np.nan),
            "zero": lambda: np.zeros(4),
            "huge": lambda: np.full(4, 1e308),
            "tiny": lambda: np.full(4, 5e-324),
            "shape": lambda: np.zeros((4, 4)),
            "big": lambda: np.broadcast_to(np.float64(0), (10**6, 10**6)),
            "complex": lambda: np.ones(4, complex),
            "object": lambda: np.array([1, 0, 0, None], dtype=object),
            "bomb": lambda: np.array([Bomb(), 0, 0, 0], dtype=object),
            "interrupting": Interrupting,
            "text": lambda: "abcd",
            "generator": lambda: (x for x in [1, 0, 0, 0]),
            "masked": lambda: np.ma.masked_all(4),
            "ints": lambda: [10**400, 0, 0, 0],
            "sub": lambda: np.array([1.0, 0, 0, 0]).view(Sub),
            "dict": lambda: {"q": 1},
            "none": lambda: [None] * 4,
        }[self.what]()


class ArrayLoops(Honest):
    def evil(self, obs):
        class Loop:
            def __array__(self, *arguments, **settings):
                while True:
                    pass

        return Loop()


class Cov(Honest):
    def __init__(self, what="negative"):
        self.what = what

    def covariance(self):
        if self.what == "raises":
            raise RuntimeError("c")
        return {"negative": np.full((3, 3), -1.0), "huge": np.eye(3) * 1e300, "shape": np.eye(2)}[self.what]


class Health(Honest):
    def __init__(self, what="text"):
        self.what = what

    def health(self):
        class Told:
            repairs, failed_at = {"negative": (-1, -1), "late": (0, 10**12)}.get(self.what, (10**30, -1))

        return "no" if self.what == "text" else Told


class BatchedBad(Honest):
    @property
    def batched(self):
        raise RuntimeError("b")


class PickleBomb(Honest):
    def __reduce__(self):
        return os._exit, (1,)


# ---- what it does where it is made


class Inits(Honest):
    def __init__(self, what="exit"):
        if what == "exit":
            os._exit(0)
        elif what == "interrupt":
            raise KeyboardInterrupt
        elif what == "loop":
            while True:
                pass


# ---- lies to the evaluation: the layout of an answer is number, kind, value, lengths of two texts


def wire():
    """Return the pipe of its answers to the evaluation, beside which only standard output can be written to."""
    for file in range(3, 64):
        try:
            if stat.S_ISFIFO(os.fstat(file).st_mode) and fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE == os.O_WRONLY:
                return file
        except OSError:
            continue
    raise RuntimeError("no pipe")


def number_of_call():
    """Return the number of the call that goes on, from the frame that serves it."""
    frame = sys._getframe()
    while "number" not in frame.f_locals:
        frame = frame.f_back
    return frame.f_locals["number"]


class Lies(Honest):
    def __init__(self, what="garbage"):
        self.what = what

    def evil(self, obs):
        last = number_of_call()
        lies = {
            "garbage": os.urandom(4096),
            "zeros": bytes(4096),
            "long": struct.pack("<IBqHH", last, 0, 0, 65535, 65535),
            "twice": b"".join(struct.pack("<IBqHH", n, 0, 0, 0, 0) for n in range(50)),
            "half": b"\0" * 3,
            "trickle": struct.pack("<IBqHH", last, 1, 0, 4000, 4000) + b"x" * 8000,
            "flood": struct.pack("<IBqHH", last, 3, 0, 0, 0) * 100_000,
            "close": b"",
        }
        answers, lie = wire(), lies[self.what]
        if self.what == "close":
            os.close(answers)
            time.sleep(10**6)
        if self.what == "trickle":
            for byte in lie:
                os.write(answers, bytes([byte]))
                time.sleep(0.05)
        while lie:
            lie = lie[os.write(answers, lie) :]
        if self.what == "half":
            time.sleep(10**6)


class Shrinks(Honest):
    """The memory under the feet of the evaluation, which would get a bus error."""

    def evil(self, obs):
        for file in range(3, 64):
            try:
                os.ftruncate(file, 0)
            except OSError:
                continue
            raise RuntimeError("it is shorter")


class Grows(Honest):
    """The memory that it shares, which no limit of its process counts."""

    def evil(self, obs):
        for file in range(3, 64):
            try:
                os.pwrite(file, b"x", 2**20)
            except OSError:
                continue
            raise RuntimeError("it is longer")


class Beats(Honest):
    """Tells again and again that the call goes on."""

    def evil(self, obs):
        answers, beat, end = wire(), struct.pack("<IBqHH", number_of_call(), 3, 0, 0, 0), time.monotonic() + 3.0
        while time.monotonic() < end:
            os.write(answers, beat)
            time.sleep(0.05)


class Races(Honest):
    """Writes into the shared memory all the time."""

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        self.thread = None

    def evil(self, obs):
        def scribble():
            while True:
                for one in found:
                    one._answers["action"][...] = np.nan
                time.sleep(0)

        found = [one for one in gc.get_objects() if type(one).__name__ == "Served" and hasattr(one, "_obs")]

        threading.Thread(target=scribble, daemon=True).start()


# ---- cheats: what they look for is not there


def truth_in(episode):
    return np.asarray(episode._truth.q_nb)[0]


class Frames(Honest):
    """Walks the frames of its caller to the environment or to the job."""

    def step(self, obs):
        frame = sys._getframe()
        while frame:
            env, job = frame.f_locals.get("env"), frame.f_locals.get("job")
            if env is not None and hasattr(env, "unwrapped"):
                return np.array(truth_in(env.unwrapped.episode))
            if job is not None:
                with open("STOLEN_SEED", "w") as file:
                    file.write(repr(job.suite_seed))
            frame = frame.f_back
        return self.q.copy()


class Collector(Honest):
    """Looks for the truth among all objects."""

    def step(self, obs):
        for one in gc.get_objects():
            kind = type(one)
            if str(kind.__module__).startswith("sins_env") and kind.__name__ in ("Episode", "Job", "Store"):
                raise RuntimeError(f"found {kind}")
        return self.q.copy()


class SeesSecrets(Honest):
    """Raises what it finds of a seed in arguments, environment and open files."""

    def evil(self, obs):
        listed = [f"/proc/self/fd/{file}" for file in os.listdir("/proc/self/fd")]
        files = sorted(os.readlink(file).partition(":")[0] for file in listed if os.path.islink(file))
        with open("/proc/self/cmdline") as arguments, open("/proc/self/environ") as environment:
            told = arguments.read() + environment.read() + repr(os.environ) + repr(sys.argv)
        readable = ctypes.CDLL(None).prctl(3, 0, 0, 0, 0)  # PR_GET_DUMPABLE: of what this process was forked from
        raise RuntimeError(f"seed {'987654321987' in told}, files {' '.join(files)}, readable {readable}")


class Patches(Honest):
    """Changes scorer, store, guard, NumPy and the clock, as it is made and as it begins."""

    def __init__(self):
        self._patch()

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        self._patch()

    def _patch(self):
        from sins_env.evaluation.estimators import guard
        from sins_env.evaluation.play import records
        from sins_env.evaluation.store import rows

        old_add, old_step, old_row = records.Scorer.add, guard.Guard.step, rows.to_row
        records.Scorer.add = lambda self, errors, failed: old_add(self, errors * 1e-3, failed)
        guard.Guard.step = lambda self, obs: old_step(self, obs)
        rows.to_row = lambda *given: old_row(*given)
        np.percentile = lambda *given, **more: np.float64(0.0)
        np.isfinite = lambda x: np.ones(np.shape(x), bool)
        time.perf_counter = time.process_time = time.monotonic = lambda: 0.0


class Slow(Honest):
    """Takes 3 ms for a step, and has its clock stand still."""

    def step(self, obs):
        time.perf_counter = lambda: 0.0
        time.sleep(3e-3)
        return self.q.copy()
