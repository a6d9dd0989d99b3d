"""What ends early leaves nobody waiting and nothing running."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

from qocjax.batch.ahead import side_by_side

DRAWS = """
import time
from multiprocessing import active_children
from qocjax._beside import process_beside

if __name__ == "__main__":
    with process_beside() as pool:
        pool.submit(int).result()
        print(active_children()[0].pid, flush=True)
        time.sleep(60)
"""

FAILS = """
import sys
import qocjax.commands.sweep as sweep
from qocjax.sweep import main
sweep.run = lambda *_, **__: {}["gone"]
sys.argv = ["qocjax.sweep", "sweep=kappa", "figures=false", "hydra.run.dir=" + sys.argv[1]]
main()
"""


def test_what_no_check_foresaw_is_a_line_with_the_way_to_the_traceback(tmp_path: Path) -> None:
    quiet = {name: value for name, value in os.environ.items() if name != "QOCJAX_TRACEBACK"}
    for told, lines in ((quiet, 1), (quiet | {"QOCJAX_TRACEBACK": "1"}, None)):
        done = subprocess.run([sys.executable, "-c", FAILS, str(tmp_path)], capture_output=True, text=True, check=False,
                              env=told)  # fmt: skip
        assert done.returncode != 0 and "KeyError: 'gone'" in done.stderr
        if lines is None:
            assert "Traceback" in done.stderr
        else:
            assert done.stderr.count("\n") == lines and "QOCJAX_TRACEBACK=1" in done.stderr, done.stderr


def test_threads_that_are_shut_down_free_who_waits_for_them() -> None:
    threads, begun, go_on = ThreadPoolExecutor(1), Event(), Event()

    def piece(k: int) -> int:
        begun.set()
        go_on.wait(10)
        return k

    def wait_for_all() -> None:
        with suppress(CancelledError, RuntimeError):  # as it waits, or as it hands out the next piece
            list(side_by_side(piece, range(4), threads, 4))

    waiting = Thread(target=wait_for_all, daemon=True)
    waiting.start()
    assert begun.wait(10)
    threads.shutdown(wait=False, cancel_futures=True)
    go_on.set()
    waiting.join(10)
    assert not waiting.is_alive()


def test_the_process_that_draws_ends_with_its_parent(tmp_path: Path) -> None:
    script = tmp_path / "draws.py"
    script.write_text(DRAWS)
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 20
    while _runs(child) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _runs(child)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    try:  # an orphan that nobody reaps is none that runs
        with open(f"/proc/{process}/stat", encoding="ascii") as status:
            return status.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
