"""Numbers of loops: late rows, copies, wraps and new beginnings, each told from the others; no row lost for it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from tables import Known, a_table

from qocjax.network import read_trace
from qocjax.network.numbering import number_loops
from qocjax.recorded import Rules, RunFiles, TopicPatterns, read_run

pytestmark = pytest.mark.filterwarnings("ignore:.*(begins anew|nothing tells how often|repeat a number)")


@pytest.mark.parametrize("width", [2**8, 2**16, 2**32])
def test_a_counter_that_wraps_goes_on(width: int) -> None:
    raw = (width - 100 + np.arange(2 * min(width, 1000))) % width
    found = number_loops(raw.tolist())
    assert (found.wraps, found.restarts, found.late) == (2 if width == 2**8 else 1, 0, 0) or width == 2**8
    np.testing.assert_array_equal(found.order, np.arange(raw.size))
    np.testing.assert_array_equal(np.diff(found.number), 1.0)


def test_late_rows_around_a_wrap_find_their_places() -> None:
    raw = [65532, 65533, 65535, 0, 65534, 1, 2, 4, 3, 5, *range(6, 60)]
    found = number_loops(raw)
    assert (found.wraps, found.restarts, found.late) == (1, 0, 2)
    assert [raw[row] for row in found.order[:8]] == [65532, 65533, 65534, 65535, 0, 1, 2, 3]


def test_numbering_that_begins_anew_drops_and_moves_nothing() -> None:
    raw = [*range(500), *range(500), *range(3, 300)]
    found = number_loops(raw)
    assert (found.wraps, found.restarts, found.late) == (0, 2, 0)
    np.testing.assert_array_equal(found.order, np.arange(len(raw)))
    assert np.unique(np.column_stack([found.session, found.number]), axis=0).shape[0] == len(raw)


def test_rows_at_the_end_that_fill_holes_are_late() -> None:
    raw = [0, 1, 2, 5, 6, *range(9, 200), 3, 4, 7, 8]
    found = number_loops(raw)
    assert found.restarts == 0 and [raw[row] for row in found.order] == list(range(200))


def test_send_times_tell_a_copy_from_a_new_loop() -> None:
    raw, times = [*range(50), *range(50)], 0.1 * np.arange(100)
    assert number_loops(raw, times, times).restarts == 1
    assert number_loops(raw, np.tile(times[:50], 2), np.tile(times[:50], 2)).restarts == 0
    assert number_loops(raw, np.tile(times[:50], 2), times).restarts == 1  # sessions that count from 0 s each


def test_a_file_without_order_is_sorted() -> None:
    numbers = np.random.default_rng(0).permutation(300)
    found = number_loops(numbers.tolist())
    assert found.restarts == 0 and numbers[found.order].tolist() == list(range(300))


def check(known: Known, folder) -> None:
    """What both readers make of a table is its truth."""
    path = folder / "loops.csv"
    known.table.to_csv(path, index=False, float_format="%.6f")
    trace = read_trace(path, "rtt", "s", sequence="sequence")
    np.testing.assert_allclose(trace.delays, known.delays, atol=2e-6, err_msg=known.story)
    filled = read_trace(path, "rtt", "s", sequence="sequence", gaps_are_lost=True)
    np.testing.assert_allclose(filled.delays, known.filled, atol=2e-6, err_msg=known.story)
    assert trace.period == pytest.approx(known.period, rel=0.02), known.story
    run = read_run(RunFiles("run", stamps=((path, None),)), Rules(TopicPatterns((), ())), quiet=True)
    (loops,) = run.loops.values()
    np.testing.assert_allclose(loops.table["loop_time"], known.delays, atol=3e-6, err_msg=known.story)
    counts = {cause: run.findings.total(cause) for cause in ("restarts", "wraps", "duplicates", "missing_numbers")}
    assert counts == known.counts, known.story


@pytest.mark.parametrize("seed", range(40))
def test_random_tables_are_read_as_what_they_are(seed: int, tmp_path) -> None:
    check(a_table(seed), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_many_random_tables_are_read_as_what_they_are(block: int, tmp_path) -> None:
    for seed in range(1000 + 60 * block, 1060 + 60 * block):
        check(a_table(seed), tmp_path)


def test_two_sessions_in_one_table_are_both_read(tmp_path) -> None:
    table = pd.DataFrame({"seq": np.tile(np.arange(500), 2), "rtt": np.repeat([20.0, 80.0], 500)})
    table.to_csv(tmp_path / "two.csv", index=False)
    with pytest.warns(UserWarning, match="'seq' begins anew 1 times and wraps 0 times"):
        trace = read_trace(tmp_path / "two.csv", "rtt", "ms", sequence="seq", period=0.1)
    assert len(np.asarray(trace.delays)) == 1000 and trace.reliability(0.05).share == 0.5
