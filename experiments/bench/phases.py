"""Where the time of a command goes: imports, composition, tracing, lowering, cache, execution, tables, figures, report.

    python experiments/bench/phases.py sweep                    # the main job
    python experiments/bench/phases.py --build ../other sweep experiment=ci
    python experiments/bench/phases.py --label 0.1.0 sweep      # and into results/phases.csv, in place of that label's

Runs the command once with clocks around its parts and prints a table: the time that each thread spends in a part and in
none that is called from it. With an empty cache of compiled programs (--cold) or as it is.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from experiments.bench.clocks import Clocks

__all__ = ["main", "profiled", "with_build", "write"]

ROOT = Path(__file__).resolve().parents[2]


def profiled(build: Path, command: str, options: list[str], environment: dict[str, str]) -> dict:
    """What a command spends where; it runs in a process and a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "clocks.json"
        arguments = [__file__, "--inside", str(found), str(time.time()), command, *options]
        done = subprocess.run(
            [sys.executable, *arguments], cwd=folder, env=with_build(build, environment),
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, encoding="utf-8",
        )  # fmt: skip
        if not found.is_file():
            raise SystemExit(f"{command} {' '.join(options)}: {done.stderr.strip()}")
        return json.loads(found.read_text(encoding="utf-8"))


def with_build(build: Path, environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """An environment in which a checkout is what is imported."""
    paths = [str(build), *filter(None, [environment.get("PYTHONPATH")])]
    return {**environment, "PYTHONPATH": os.pathsep.join(paths)}


def inside(found: Path, begun: float, command: str, options: list[str]) -> None:
    """In that process: runs the command under clocks."""
    import runpy

    clocks = Clocks(begun)
    clocks.start()
    sys.path[0] = os.environ["PYTHONPATH"].split(os.pathsep)[0]  # not the folder of this file
    sys.argv = [f"qocjax.{command}", *options]
    try:
        runpy.run_module(f"qocjax.{command}", run_name="__main__", alter_sys=True)
    except SystemExit:
        pass
    finally:
        own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        cores = {"processor_s": own.ru_utime + own.ru_stime, "other_processes_s": others.ru_utime + others.ru_stime}
        found.write_text(json.dumps(clocks.result() | cores), encoding="utf-8")


def printed(record: dict) -> str:
    """The table as Markdown."""
    import pandas as pd

    from experiments.bench.report import markdown

    rows = [
        (part, *(f"{record['parts'].get(part, {}).get(where, 0.0):.2f}" for where in ("main", "others")))
        for part in record["parts"]
    ]
    rows.append(("all", f"{record['wall_s']:.2f}", ""))
    table = markdown(pd.DataFrame(rows, columns=["part", "main thread (s)", "other threads (s)"]))
    programs = ", ".join(f"{name} {count}" for name, count in record["programs"].items())
    return (f"{table}\n\nPrograms: {programs}. Processor time: {record['processor_s']:.1f} s, of other processes "
            f"{record['other_processes_s']:.1f} s.")  # fmt: skip


def write(path: Path, label: str, command: str, record: dict) -> None:
    """Puts a profile into the table of all, in place of one of the same label and command."""
    import pandas as pd

    programs = {f"programs {name}": {"main": count} for name, count in record["programs"].items()}
    cores = {name: {"main": record[name]} for name in ("wall_s", "processor_s", "other_processes_s")}
    rows = [
        {"build": label, "command": command, "part": part, "main": times.get("main"), "others": times.get("others")}
        for part, times in (record["parts"] | cores | programs).items()
    ]
    old = pd.read_csv(path) if path.is_file() else pd.DataFrame(columns=list(rows[0]))
    kept = old[(old["build"] != label) | (old["command"] != command)]
    pd.DataFrame([*kept.to_dict("records"), *rows]).to_csv(path, index=False, float_format="%.3g")


def main() -> None:
    """Command line."""
    if sys.argv[1:2] == ["--inside"]:
        inside(Path(sys.argv[2]), float(sys.argv[3]), sys.argv[4], sys.argv[5:])
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--build", type=Path, default=ROOT, help="checkout whose command runs")
    parser.add_argument("--cold", action="store_true", help="with an empty cache of compiled programs")
    parser.add_argument("--label", help="of the build, in results/phases.csv")
    parser.add_argument("command", help="sweep, advise, ...")
    parser.add_argument("options", nargs=argparse.REMAINDER)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        environment = dict(os.environ) | ({"JAX_COMPILATION_CACHE_DIR": cache} if given.cold else {})
        record = profiled(given.build.resolve(), given.command, given.options, environment)
    print(printed(record))
    if given.label:
        command = " ".join([given.command, *("cold" for _ in range(given.cold)), *given.options])
        write(Path(__file__).parent / "results" / "phases.csv", given.label, command, record)


if __name__ == "__main__":
    main()
