"""Wrong inputs for every command, each run in a process of its own: `python tests/wrong_inputs.py 500 --seed 1`.

Each option of each command is given what it cannot be, or a size that no machine has; files that they name are damaged
or swapped. A run that is refused ends in one line with code 2 (1 where the rest stands). What may be right goes on to
simulate, and is stopped there.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from damage import damaged

ROOT = Path(__file__).parents[1]
TIME, MEMORY = 30.0, 2 << 30  # s and bytes that a refusal may take at most, on a machine that others use too
ADDRESSES = 12 << 30  # bytes; what asks for more gets MemoryError instead of the machine's memory
SIMULATES = 77  # code of a run that is not refused

STUDY = ["sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[200,400]", "sweep.seeds=2",
         "sweep.evaluation_seeds=2", "scenario.horizon=2", "loop.tau=0.1", "figures=false", "report=false"]  # fmt: skip
QUICK = ["scenario.horizon=2", "loop.tau=0.1", "figures=false"]
COMMANDS: dict[str, list[str]] = {
    "sweep": STUDY,
    "tune": [*QUICK, "tune.steps=2", "tune.starts=1", "tune.seeds=2", "tune.evaluation_seeds=2"],
    "codesign": [*QUICK, "search.tau=[0.1]", "search.budget=64", "search.repetitions=1"],
    "qos": [*QUICK, "qos.seeds=4"],
    "advise": [*QUICK, "path={log}", "network.compute=0.02"],
    "validate": [*QUICK, "measured=surrogate", "validation.seeds=2"],
    "compare": ["studies=[{study},{other}]", "figures=false", "report=false"],
    "show": ["scenario.horizon=2", "loop.tau=0.1"],
    "ingest": ["path={loops}", "figures=false"],
    "fleet": ["fleet.robots=[1,2]", "fleet.horizon=2", "fleet.seeds=2", "fleet.evaluation_seeds=2", "figures=false",
              "report=false"],
}  # fmt: skip

BIG = "1" + "0" * 400
NUMBERS = ["1e30", "-1e30", "1e300", "1e-30", "1e-9", "1e-300", BIG, f"-{BIG}", f"{BIG}.5", f"0.{'0' * 400}1", "inf",
           "-inf", "nan", "0", "-1", "1", "5", "0.5", "2.5", "100000", "10000000", "1000000000000",
           "5000000000"]  # fmt: skip
LISTS = ["[]", "[1]", "[[1]]", "[nan]", "[1e30]", f"[{BIG}]", "[null]", "[{a: 1}]", "[1,2,3,4,5,6,7,8]", "[[1,2],[3]]",
         "[1,2]", "[1e-30,1]", "[1,1]", "[-1,1]", "[0.5,1e30]", "[1000000000000]", "[[1e30,1e30,0]]", "[a,b]",
         "[[[1,2,3]]]", "[0,0]", "[0,0,0]", "[1,2,3]", "[5000000]"]  # fmt: skip
TEXTS = ["null", "true", "much", "''", "{}", "{a: 1}", "a\\nb", "1_0", "0x1f", "'5'", "/dev/null", "/", "${nothing}",
         "/dev/zero", "ä€", "%s{0}", "{", "\\x00", "x" * 5000]  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What came of an input."""

    command: str
    options: list[str]
    code: int  # negative for a signal
    seconds: float  # of a core
    memory: int  # bytes
    err: str
    out: str

    @property
    def fault(self) -> str:
        """What is wrong with it; empty where it was refused as it should be, or may be right."""
        if self.code < 0 or self.code not in (0, 1, 2, SIMULATES):
            return f"ended with {self.code}"
        if self.seconds > TIME:
            return f"took {self.seconds:.0f} s"
        if self.memory > MEMORY:
            return f"took {self.memory >> 20} MiB"
        if "Traceback" in self.err or "QOCJAX_TRACEBACK" in self.err:
            return "unforeseen"
        if self.err.startswith("error: memory"):
            return "memory"
        errors = [line for line in self.err.splitlines() if not line.startswith(("note: ", "simulating", "fitting"))]
        if self.code in (0, SIMULATES) and any(BIG in each and f"{BIG}." not in each for each in self.options):
            return "accepted"
        if self.code == 2 and (len(errors) != 1 or not errors[0].startswith("error: ") or len(errors[0]) < 12):
            return "not one line"
        return ""


def leaves(values: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Options with their values."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


class Inputs:
    """Random inputs that are wrong, or may be."""

    def __init__(self, home: Path, studies: bool = True) -> None:
        """Makes the files that commands read, in a folder; without studies that are right where `studies` is false."""
        self.files = _files(home, studies)
        self.home, self.studies = home, studies
        self.names = {command: self._names(command) for command in COMMANDS}

    def base(self, command: str) -> list[str]:
        """Options of a small run that is right."""
        return [each.format(**self.files) for each in COMMANDS[command]]

    def random(self, rng: random.Random, command: str) -> list[str]:
        """Options of a run that is wrong, or may be."""
        if rng.random() < 0.1 and (given := self._damaged(rng, command)):
            return [*self.base(command), *given]
        name, usual = rng.choice(list(self.names[command].items()))
        likely = LISTS if isinstance(usual, list) else TEXTS if isinstance(usual, str) else NUMBERS
        value = rng.choice(likely if rng.random() < 0.7 else NUMBERS + LISTS + TEXTS)
        return [*self.base(command), f"{name}={value}"]

    def _names(self, command: str) -> dict[str, Any]:
        from hydra import compose, initialize_config_dir
        from omegaconf import OmegaConf

        from qocjax._conf import add_resolver, conf_dir, hydra_base
        from qocjax.commands.command_line import _expanded
        from qocjax.commands.own_folder import own_folder

        add_resolver("own_folder", own_folder)
        short = importlib.import_module(f"qocjax.{command}").main.short
        with initialize_config_dir(str(conf_dir()), **hydra_base()):
            found = compose(command, _expanded(self.base(command), short))
        values: Any = OmegaConf.to_container(found, resolve=False)
        return {name: value for name, value in leaves(values) if not name.startswith(("help", "hydra"))}

    def _damaged(self, rng: random.Random, command: str) -> list[str]:
        """An option that names a damaged file."""
        at = rng.randrange(1 << 30)
        copy = self.home / f"damaged-{at}"
        if command in ("compare", "sweep", "qos", "tune"):
            if not self.studies:
                return []
            shutil.copytree(self.files["study"], copy)
            file = copy / rng.choice(["record.json", "config.yaml", "study.json", "policies.csv", "results.csv"])
        elif command in ("advise", "ingest"):
            copy.mkdir()
            file = copy / Path(self.files["log" if command == "advise" else "loops"]).name
            file.write_bytes(Path(self.files["log" if command == "advise" else "loops"]).read_bytes())
        else:
            return []
        content = file.read_bytes()
        odd = [b"", b"[]", b"3", b"null", b"{}", b"\xff\xfe", b"{" * 3000, b"[1e999]", BIG.encode(), b"\0" * 100]
        file.write_bytes(rng.choice(odd) if rng.random() < 0.3 else damaged(content, at).content)
        return {
            "compare": [f"studies=[{copy},{self.files['other']}]"],
            "sweep": [f"sweep.scale={copy}"] if rng.random() < 0.5 else [f"resume={copy}", f"hydra.run.dir={copy}"],
            "qos": [f"qos.scale={copy}"], "tune": [f"tune.scale={copy}"],
        }.get(command, [f"path={file}"])  # fmt: skip


def _files(home: Path, studies: bool) -> dict[str, str]:
    """Small files that are right."""
    import numpy as np

    rng = np.random.default_rng(0)
    times = 60 + rng.gamma(2.0, 20.0, 400)
    log, loops = home / "ping.txt", home / "loops.csv"
    log.write_text("PING 10.0.0.1 (10.0.0.1) 56(84) bytes of data.\n" + "".join(
        f"64 bytes from 10.0.0.1: icmp_seq={k + 1} ttl=64 time={t:.1f} ms\n" for k, t in enumerate(times)))  # fmt: skip
    sent = 1e3 + 0.1 * np.arange(400)
    rows = [f"{k},{s:.4f},{s + 0.01:.4f},{s + 0.03:.4f},{s + t / 1e3:.4f}"
            for k, (s, t) in enumerate(zip(sent, times, strict=True))]  # fmt: skip
    loops.write_text("sequence,uplink_send,edge_receive,edge_send,downlink_receive\n" + "\n".join(rows) + "\n")
    found = {"log": str(log), "loops": str(loops)}
    for name, more in (("study", []), ("other", ["loop.hold=zero"])):
        found[name] = str(home / name)
        if not studies:
            continue
        outcome = attempt("sweep", [*STUDY, *more, f"hydra.run.dir={home / name}"], whole=True)
        assert outcome.code == 0, outcome
    return found


def attempt(command: str, options: list[str], *, whole: bool = False, time_limit: float = 8 * TIME) -> Outcome:
    """Runs a command in a child of this process, which has imported all it needs."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            _child(command, options, out.fileno(), err.fileno(), whole)
        status, used = _ended(child, time_limit)
        texts = [(file.seek(0), file.read(20000).decode(errors="replace"))[1] for file in (err, out)]
    code = os.waitstatus_to_exitcode(status)
    return Outcome(command, options, code, used.ru_utime + used.ru_stime, used.ru_maxrss << 10, *texts)


def _ended(child: int, limit: float) -> tuple[int, resource.struct_rusage]:
    handle = os.pidfd_open(child)
    try:
        if not select.select([handle], [], [], limit)[0]:
            os.killpg(child, signal.SIGKILL)
        _, status, used = os.wait4(child, 0)
    finally:
        os.close(handle)
    return status, used


def _child(command: str, options: list[str], out: int, err: int, whole: bool) -> None:
    """The command; never returns."""
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    os.dup2(out, 1), os.dup2(err, 2)
    code = 1
    try:
        if not whole:
            _stop_where_it_simulates()
        sys.argv = [f"qocjax.{command}", *options]
        importlib.import_module(f"qocjax.{command}").main()
        code = 0
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BaseException:
        import traceback

        traceback.print_exc()
    with contextlib.suppress(Exception):
        sys.stdout.flush(), sys.stderr.flush()
    os._exit(code)


def _stop_where_it_simulates() -> None:
    import qocjax.batch.gradient
    import qocjax.batch.runner
    import qocjax.single

    def stop(*_: Any, **__: Any) -> Any:
        with contextlib.suppress(Exception):
            sys.stdout.flush(), sys.stderr.flush()
        os._exit(SIMULATES)

    qocjax.batch.runner.Runner.run = stop  # type: ignore[method-assign]
    sys.modules["qocjax.single"]._simulate = stop  # type: ignore[attr-defined]


def prepare(work: bool = True) -> None:
    """Imports what children share, what commands do too; starts no backend of JAX, which would not live on in them."""
    for command in COMMANDS:
        importlib.import_module(f"qocjax.{command}").main.model()
    if not work:
        return
    for command in COMMANDS:
        importlib.import_module(f"qocjax.commands.{command}")
    for name in ("sweep_work", "sweep_page"):
        importlib.import_module(f"qocjax.commands.{name}")


def main() -> None:
    """Tries inputs; prints each with a fault as a line of JSON, and in the end how many there were."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--command", choices=list(COMMANDS))
    parser.add_argument("--all", action="store_true", help="print every outcome")
    parser.add_argument("--no-studies", action="store_true", help="damage none, which would have to be simulated first")
    asked = parser.parse_args()
    prepare(work=not asked.no_studies)
    rng, commands = random.Random(asked.seed), [asked.command] if asked.command else list(COMMANDS)
    faults, codes = 0, {}
    with tempfile.TemporaryDirectory() as home:
        inputs = Inputs(Path(home), not asked.no_studies)
        for k in range(asked.count):
            command = commands[k % len(commands)]
            options = inputs.random(rng, command)
            found = attempt(command, [f"hydra.run.dir={home}/run-{k}", *options])
            codes[found.code] = codes.get(found.code, 0) + 1
            if found.fault or asked.all:
                faults += bool(found.fault)
                print(json.dumps({"fault": found.fault, **asdict(found)}), flush=True)
    print(json.dumps({"tried": asked.count, "faults": faults, "codes": codes}))
    sys.exit(faults > 0)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
