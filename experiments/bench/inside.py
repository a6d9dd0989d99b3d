"""What XLA makes of one tick: fusions, bytes through them, vector instructions.

    python experiments/bench/inside.py

Reads the optimised program and, where objdump is installed, the machine code. Prints a table.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pandas as pd

from experiments.bench.report import markdown

__all__ = ["main", "tick_loop", "while_body"]

_SHAPE = re.compile(r"\b(pred|s32|u32|f32)\[([\d,]*)\]")
_VECTOR = re.compile(r"%[xyz]mm")
_MEMORY = re.compile(r"\(.*%r")


def while_body(text: str) -> list[str]:
    """Instructions of the longest body of a while loop, from the text of an optimised program."""
    starts = {m[1]: m.end() for m in re.finditer(r"^(?:ENTRY )?%(\S+) \(.*\{$", text, re.MULTILINE)}
    bodies = [text[starts[name] : text.index("\n}", starts[name])] for name in re.findall(r"body=%([\w.\-]+)", text)]
    lines = max((body.splitlines() for body in bodies), key=len)
    return [line.split(", metadata=")[0] for line in lines if " = " in line]


def moved(lines: list[str], rows: set[int]) -> int:
    """Bytes that fusions and copies read and write in a tick; of an array of rows by tick, one row."""
    shapes = {m[1]: m[2] for line in lines if (m := re.match(r"\s*(?:ROOT )?%(\S+) = (\S+)", line))}
    total = 0
    for line in lines:
        match = re.match(r"\s*(?:ROOT )?%(\S+) = \S+ (?:fusion|copy)\((.*?)\)", line)
        if match:
            names = [match[1], *re.findall(r"%([\w.\-]+)", match[2])]
            total += sum(_bytes(shapes[name], rows) for name in names)
    return total


def _bytes(shape: str, rows: set[int]) -> int:
    kind, sizes = _SHAPE.match(shape).groups()  # type: ignore[union-attr]
    dims = [int(n) for n in sizes.split(",") if n]
    return math.prod(dims[1:] if dims and dims[0] in rows else dims) * (1 if kind == "pred" else 4)


def tick_loop(assembly: str) -> tuple[int, int]:
    """Instructions on vector registers in the loop with most of them that closes once, and those of them on memory."""
    code = [m.groups() for line in assembly.splitlines() if (m := re.match(r"\s+([0-9a-f]+):\t(\S+)\s*(.*)", line))]
    at = {int(address, 16): k for k, (address, _, _) in enumerate(code)}
    best = (0, 0)
    for end, (_, operation, argument) in enumerate(code):
        target = re.match(r"[0-9a-f]+(?= )", argument)
        begin = at.get(int(target[0], 16), end) if operation.startswith("j") and target else end
        vector = [arg for _, _, arg in code[begin : end + 1] if _VECTOR.search(arg)]
        best = max(best, (len(vector), sum(bool(_MEMORY.search(arg)) for arg in vector)))
    return best


def main() -> None:
    """Command line."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XLA_FLAGS"] = f"--xla_dump_to={folder}"
        from experiments.bench.one_batch import OneBatch, Program
        from qocjax._xla import request_whole_loop

        request_whole_loop()
        batch = OneBatch(16, 32, 3000)
        program = Program(batch)
        lines = while_body(program.compiled.as_text() or "")
        arrays = [line for line in lines if re.search(r"= \w+\[\d+,", line)]
        rows: list[tuple[str, str]] = [
            ("fusions on arrays in a tick", str(sum(" fusion(" in line for line in arrays))),
            ("copies of arrays in a tick", str(sum(" copy(" in line for line in arrays))),
        ]
        amount = moved(lines, {batch.ticks, program.plan.slots}) * batch.ticks / batch.robot_steps
        rows.append(("bytes through fusions and copies for each robot-step", f"{amount:.0f}"))
        if shutil.which("objdump"):
            found = [tick_loop(_disassembled(path)) for path in Path(folder).glob("*_totals*.o")]
            rows.append(("vector instructions of a tick in the machine code", str(max(found)[0])))
            rows.append(("of them, with an operand in memory", str(max(found)[1])))
    print(markdown(pd.DataFrame(rows, columns=["one tick of qocjax", "count"])))


def _disassembled(path: Path) -> str:
    return subprocess.check_output(["objdump", "-d", "--no-show-raw-insn", str(path)], text=True)


if __name__ == "__main__":
    main()
