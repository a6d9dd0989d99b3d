"""What ends early leaves nobody waiting and nothing running."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from pathlib import Path
from threading import Event, Thread

import pytest
from stopped import CODES, not_ignored  # noqa: F401 - a fixture

from qocjax._beside import process_beside
from qocjax.batch.ahead import side_by_side
from qocjax.commands.stopping import stoppable

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

# What holds a program up, in a process that says that it works, and what it is to end with.
HELD = {
    "outside of Python": "hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)",
    "where exceptions are lost": """
        while True:
            try:
                time.sleep(60)
            except BaseException:
                pass
""",
    "where they are taken for errors": """
        try:
            time.sleep(60)
        except BaseException:
            raise ValueError("much") from None
""",
    "by what is put away": """
        try:
            time.sleep(60)
        finally:
            time.sleep(60)
""",
    "by a thread": "ThreadPoolExecutor(1).submit(time.sleep, 60).result()",
}
PROGRAM = """
import hashlib, time
from tempfile import TemporaryDirectory
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context
from qocjax._beside import without_interrupts
from qocjax.commands.stopping import as_program, stoppable

def main():
    with stoppable(lambda: "so it goes on"):
        print("works", flush=True)
        {held}

as_program(main)
"""

FAILS = """
import sys
import qocjax.commands.sweep as sweep
from qocjax.sweep import main
sweep.run = lambda *_, **__: {}["gone"]
sys.argv = ["qocjax.sweep", "sweep=kappa", "figures=false", "hydra.run.dir=" + sys.argv[1]]
main()
"""


pytestmark = pytest.mark.usefixtures("not_ignored")


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


@pytest.mark.parametrize(("held", "way"), list(zip(HELD, [*CODES, *CODES], strict=False)))
def test_a_program_ends_whatever_holds_it_up(held: str, way: signal.Signals) -> None:
    with started(HELD[held]) as process:
        process.send_signal(way)
        _, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (CODES[way], "stopped: so it goes on\n")


def test_what_puts_itself_away_has_time_to_but_a_second_signal_ends_it(tmp_path: Path) -> None:
    """Files go that a `with` holds; what takes longer is cut short."""
    folder = f"TemporaryDirectory(dir={str(tmp_path)!r})"
    with started(f"with {folder}: print('there', flush=True); time.sleep(60)") as process:
        assert process.stdout is not None and process.stdout.readline() == "there\n" and list(tmp_path.iterdir())
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130
    assert not list(tmp_path.iterdir())
    slow = "print('on its way', flush=True); hashlib.pbkdf2_hmac('md5', b'', b'', 2**31 - 1)"
    with started(f"try: print('there', flush=True); time.sleep(60)\n        finally: {slow}") as process:
        assert process.stdout is not None and process.stdout.readline() == "there\n"
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == "on its way\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 143


def test_a_signal_that_is_ignored_stays_so() -> None:
    """As under `nohup`, which has a program outlive its terminal."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with started("time.sleep(0.5)\n        print('done', flush=True)") as process:
            process.send_signal(signal.SIGHUP)
            out, err = process.communicate(timeout=30)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (process.returncode, out, err) == (0, "done\n", "")


def test_a_process_that_is_more_than_the_program_gets_an_exception() -> None:
    handlers = [signal.getsignal(number) for number in CODES]
    with pytest.raises(KeyboardInterrupt, match="so it goes on"), stoppable(lambda: "so it goes on"):
        raise KeyboardInterrupt
    assert handlers == [signal.getsignal(number) for number in CODES]


def test_the_process_beside_is_ended_with_its_work_or_without(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), process_beside() as pool:
        late = pool.submit(time.sleep, 600)
        (child,) = active_children()
        raise KeyboardInterrupt
    assert child.pid is not None and not _runs(child.pid)
    with pytest.raises(BrokenExecutor):
        late.result(30)


def test_a_kill_leaves_nothing_for_the_system_to_warn_of() -> None:
    """Semaphores, as those of Dask, are cleared away without a word."""
    held = "with without_interrupts(): queue = get_context('spawn').Queue()"
    with started(f"{held}\n        print('holds', flush=True); time.sleep(60)") as process:
        assert process.stdout is not None and process.stdout.readline() == "holds\n"
        process.kill()
        assert process.communicate(timeout=30)[1] == ""


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


@contextmanager
def started(held: str) -> Iterator[subprocess.Popen[str]]:
    """A program that works."""
    command = [sys.executable, "-c", PROGRAM.format(held=held)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "works\n"
            yield process
        finally:
            process.kill()


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
