"""Readers: what is taken in, and the place that an error names."""

from __future__ import annotations

import gzip
import json
import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qocjax.network import read_histogram, read_samples, read_trace

pytestmark = pytest.mark.filterwarnings("ignore:.*nothing tells how often loops were measured")


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a file and returns its path."""

    def to_file(text: str, name: str = "loops.csv") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return to_file


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_units(write: Callable[..., Path], unit: str, factor: float) -> None:
    trace = read_trace(write("rtt\n34\n120\n"), "rtt", unit)
    np.testing.assert_allclose(np.asarray(trace.delays), [34 * factor, 120 * factor], rtol=1e-15)
    assert trace.name == "loops" and trace.source.endswith("loops.csv")


def test_a_measured_100_ms_counts_for_100_ms(write: Callable[..., Path]) -> None:
    assert read_trace(write("rtt\n100\n"), "rtt", "ms").reliability(0.1).share == 1.0


@pytest.mark.parametrize(
    "text",
    [
        "seq,rtt,x\n1,0.1,\n2,,5\n3,inf,5\n4,LOST,5\n5,0.2,5\n",
        "seq;rtt;x\n1;0.1;\n2;;5\n3;inf;5\n4;lost;5\n5;0.2;5\n",
        "seq\trtt\tx\n1\t0.1\t1\n2\t\t5\n3\tinf\t5\n4\tlost\t5\n5\t0.2\t5\n",
        "# a comment\n\n  seq rtt   x\n1 0.1 5\n2  5\n3 +Infinity 5\n4 lost 5 \n\n5   0.2\t5\n",
        '\ufeff"seq", "rtt", "x"\r\n1, 0.1,\r\n2, ,5\r\n3,Inf,5\r\n4,lost,5\r\n5,0.2,5,,\r\n',
    ],
    ids=["comma", "semicolon", "tab", "blanks", "spreadsheet"],
)
def test_separators_and_losses(write: Callable[..., Path], text: str) -> None:
    np.testing.assert_array_equal(read_trace(write(text), "rtt", "s").delays, [0.1, math.inf, math.inf, math.inf, 0.2])


def test_separator_may_be_given(write: Callable[..., Path]) -> None:
    path = write("a,b|rtt\n1|0.1\n2|0.2\n")
    np.testing.assert_array_equal(read_trace(path, "rtt", "s", separator="|").delays, [0.1, 0.2])
    path = write("delay(ms) at,x\n5 1\n6 2\n")
    np.testing.assert_array_equal(read_trace(path, "delay(ms)", "ms", separator=" ").delays, [0.005, 0.006])


def test_sequence_orders_the_rows(write: Callable[..., Path]) -> None:
    path = write("seq,rtt\n3.0,0.3\n1.0,0.1\n7.0,0.7\n2.0,inf\n")
    np.testing.assert_array_equal(read_trace(path, "rtt", "s").delays, [0.3, 0.1, 0.7, math.inf])
    np.testing.assert_array_equal(read_trace(path, "rtt", "s", sequence="seq").delays, [0.1, math.inf, 0.3, 0.7])
    filled = read_trace(path, "rtt", "s", sequence="seq", gaps_are_lost=True).delays
    np.testing.assert_array_equal(filled, [0.1, math.inf, 0.3, math.inf, math.inf, math.inf, 0.7])


def test_sequence_may_have_more_digits_than_a_float(write: Callable[..., Path]) -> None:
    path = write("stamp,rtt\n1700000000000000003,0.3\n1700000000000000001,0.1\n1700000000000000002,0.2\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_trace(path, "rtt", "s", sequence="stamp").delays, [0.1, 0.2, 0.3])


def test_of_duplicates_the_smallest_delay_counts(write: Callable[..., Path]) -> None:
    path = write("seq,rtt\n1,0.1\n2,inf\n2,0.3\n2,0.2\n1,0.4\n")
    with pytest.warns(UserWarning, match=r"3 rows repeat a number of 'seq'"):
        np.testing.assert_array_equal(read_trace(path, "rtt", "s", sequence="seq").delays, [0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "options", "period", "origin"),
    [
        ("pub_time(ms) delay\n1722419558737 1\n1722419558793 1\n1722419558848 1\n", {}, 0.0555,
         "column 'pub_time(ms)'"),
        ("send_timestamp,delay\n1639276166.66,1\n1639276166.71,1\n1639276166.76,\n", {}, 0.05,
         "column 'send_timestamp'"),
        ("client_send,delay\n1526410284213.0,1\n1526410284280.0,1\n", {}, 0.067, "column 'client_send'"),
        ("source_stamp,delay\n0.0,1\n0.02,1\n0.04,1\n9.04,1\n9.06,1\n", {}, 0.02, "column 'source_stamp'"),
        ("timestamp,delay\n1700000000000000001,1\n1700000000020000001,1\n", {}, 0.02, "column 'timestamp'"),
        ("when,delay\n5,1\n25,1\n,1\n45,1\n", {"stamp": "when", "stamp_unit": "ms"}, 0.02, "column 'when'"),
        ("sent_ms,delay\n5,1\n25,1\n45,1\n5,1\n25,1\n", {}, 0.02, "column 'sent_ms'"),  # begins anew
        ("sent(s),delay\n" + "".join(f"{k},1\n" for k in range(9) for _ in range(20)), {}, 0.0447,
         "column 'sent(s)'"),
        ("sent(ms),seq,delay\n0,0,1\n40,2,1\n60,3,1\n100,5,1\n120,6,1\n140,7,1\n160,8,1\n", {"sequence": "seq"}, 0.02,
         "column 'sent(ms)'"),
        ("sent_ms,delay\n5,1\n25,1\n", {"period": 0.03}, 0.03, "given"),
    ],
    ids=["CICV5G", "CLEAVE", "EdgeDroid", "own trace", "ns", "named", "anew", "coarse", "lost rows absent", "given"],
)  # fmt: skip
def test_period_is_that_of_the_send_times(
    write: Callable[..., Path], text: str, options: dict, period: float, origin: str
) -> None:
    trace = read_trace(write(text), "delay", "ms", **options)
    assert trace.period == pytest.approx(period, rel=1e-9) and trace.period_from == origin


def test_a_burst_counts_by_its_mean(write: Callable[..., Path]) -> None:
    rows = "".join(f"{100 * k + j},1\n" for k in range(50) for j in range(5))
    assert read_trace(write("sent(ms),rtt\n" + rows), "rtt", "ms").period == pytest.approx(0.02, rel=0.02)


def test_what_has_no_period_says_so(write: Callable[..., Path]) -> None:
    with pytest.warns(UserWarning, match=r"loops.csv: nothing tells how often loops were measured"):
        assert read_trace(write("time,rtt\n1,1\n2,1\n"), "rtt", "ms").period is None
    with pytest.raises(ValueError, match=r"stamp_unit: got None for column 'when' of .*, expected s, ms, us or ns"):
        read_trace(write("when,rtt\n1,1\n2,1\n"), "rtt", "ms", stamp="when")


def test_fields_beyond_the_names_are_left_out_aloud(write: Callable[..., Path]) -> None:
    path = write("rtt x\n1 2\n1 2 3 4\n")
    with pytest.warns(UserWarning, match="rows of 4 fields for 2 names"):
        np.testing.assert_array_equal(read_trace(path, "rtt", "s").delays, [1.0, 1.0])


def test_samples_are_a_law(write: Callable[..., Path]) -> None:
    law = read_samples(write("rtt,x\n10,1\ninf,1\n20,1\n30,1\n"), "rtt", "ms")
    np.testing.assert_array_equal(law.cdf([0.0099, 0.01, 0.03]), [0.0, 0.25, 0.75])
    assert law.source.endswith("loops.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rtt\n0.1\n-0.2\n", r"loops.csv, line 3, column 'rtt': got -0.2, expected a delay >= 0"),
        ("rtt\n0.1\n\n-inf\n", r"line 4, column 'rtt': got -inf, expected a delay >= 0"),
        ("rtt\n0.1\nfast\n", r"line 3, column 'rtt': got 'fast', expected a number"),
        ("rtt\n1_000\n", r"line 2, column 'rtt': got '1_000', expected a number"),
        ("rtt;x\n0,1;1\n0.1;1\n", r"line 2, column 'rtt': got '0,1', expected a number"),
        ("rtt\n" + 400 * "9" + "\n", r"line 2, column 'rtt': got '9999999999"),
        ("rtt\n" + 5000 * "9" + "\n", r"line 2, column 'rtt': got '9999999999"),
        ("seq,delay\n1,0.1\n", r"has no column 'rtt'; its columns are 'seq', 'delay'"),
        ("rtt,rtt\n1,2\n", r"has more than one column 'rtt'"),
        ("rtt,x\n", r"has no row below its line of names"),
        ("", r"has no column 'rtt'"),
        ("rtt,x\n,1\ninf,2\n", r"column 'rtt': all 2 are lost, expected at least one delay"),
        ("seq,rtt\n1,0.1\n2\n", r"line 3: has 1 fields, expected 2"),
        ("seq,rtt\n1,0,1\n", r"line 2: has 3 fields, expected 2"),
        ("seq rtt\n1 0.1\n2\n", r"line 3: has 1 fields, expected 2"),
    ],
)
def test_errors_name_the_place(write: Callable[..., Path], text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_trace(write(text), "rtt", "s")


def test_errors_of_arguments(write: Callable[..., Path], tmp_path: Path) -> None:
    path = write("seq,time,rtt\n1,0.5,0.1\n900,inf,0.2\n")
    with pytest.raises(ValueError, match=r"unit: got 'sec' for column 'rtt' of .*, expected 's', 'ms', 'us', 'ns'"):
        read_trace(path, "rtt", "sec")
    with pytest.raises(ValueError, match=r"gaps_are_lost: got True without a sequence column"):
        read_trace(path, "rtt", "s", gaps_are_lost=True)
    with pytest.raises(ValueError, match=r"column 'seq' spans 900 numbers in 2 rows"):
        read_trace(path, "rtt", "s", sequence="seq", gaps_are_lost=True)
    with pytest.raises(ValueError, match=r"line 3, column 'time': got 'inf', expected a finite number"):
        read_trace(path, "rtt", "s", sequence="time")
    with pytest.raises(ValueError, match=r"column 'x' has fractions"):
        read_trace(write("x,rtt\n0.5,1\n1,1\n"), "rtt", "s", sequence="x", gaps_are_lost=True)
    with pytest.raises(ValueError, match=r"separator: got ', ', expected one character"):
        read_trace(path, "rtt", "s", separator=", ")
    with pytest.raises(ValueError, match=r"none.csv: no such file"):
        read_trace(tmp_path / "none.csv", "rtt", "s")
    with pytest.raises(ValueError, match=r"cannot be read"):
        read_samples(tmp_path, "rtt", "s")
    (tmp_path / "binary").write_bytes(b"rtt\n\xff\xfe\n")
    with pytest.raises(ValueError, match=r"is no text in UTF-8"):
        read_samples(tmp_path / "binary", "rtt", "s")


def _histogram(*bins: tuple[str, str]) -> str:
    return "<histogram>" + "".join(f'<bin low="{low}">{count}</bin>\n' for low, count in bins) + "</histogram>"


def test_histogram_is_uniform_within_its_bins(write: Callable[..., Path]) -> None:
    text = _histogram(("-inf ms", "0"), ("1ms", "0"), ("2 ms", "30"), ("3ms", "0"), ("4ms", "10"), ("8 ms", "0"))
    law = read_histogram(write(text))
    np.testing.assert_allclose(law.cdf([0.002, 0.0025, 0.003, 0.0035, 0.006, 0.008]), [0, 0.375, 0.75, 0.75, 0.875, 1])
    np.testing.assert_allclose(law.quantile([0.0, 1.0]), [0.002, 0.008])


def test_counts_may_be_decimal(write: Callable[..., Path]) -> None:
    """As DETERMINISTIC6G's own converter writes them: shares times a million."""
    bins = [("-inf ms", "0"), ("3.141 ms", "39000000.0"), ("3.282 ms", "126000000.0"), ("3.423 ms", "250000000.0"),
            ("3.564 ms", "0.0")]  # fmt: skip
    law = read_histogram(write(_histogram(*bins)))
    np.testing.assert_allclose(law.probability, [0, 39 / 415, 165 / 415, 1], rtol=1e-15)
    np.testing.assert_allclose(law.delay, [3.141e-3, 3.282e-3, 3.423e-3, 3.564e-3], rtol=1e-15)


def test_histograms_of_the_delay_emulator(write: Callable[..., Path]) -> None:
    rows = write("4180000,12,ns\n4193600,30,ns\n4207200,0,ns\n")
    objects = [{"count": 12, "lower_bound": 4180000, "upper_bound": 4193600, "unit": "ns"},
               {"count": 30, "lower_bound": 4193600, "upper_bound": 4207200, "unit": "ns"}]  # fmt: skip
    for path in (rows, write(json.dumps(objects), "hist.json")):
        law = read_histogram(path)
        np.testing.assert_allclose(law.probability, [0, 12 / 42, 1], rtol=1e-15)
        np.testing.assert_allclose(law.delay, [4.18e-3, 4.1936e-3, 4.2072e-3], rtol=1e-15)
    objects[1] |= {"lower_bound": 4200000}
    law = read_histogram(write(json.dumps(objects), "hist.json"))  # nothing lies in between
    np.testing.assert_allclose(law.cdf([4.1936e-3, 4.2e-3]), [12 / 42, 12 / 42], rtol=1e-9)


GRAMMAR = {
    "NaN is lost": ("seq,rtt\n0,20.0\n1,NaN\n2,nan\n3,20.0\n", "rtt", "ms", {}),
    "decimal comma": ("seq;rtt\n0;20,0\n1;\n2;\n3;20,0\n", "rtt", "ms", {}),
    "unit in the name": ("seq,rtt(ms)\n0,20\n1,\n2,\n3,20\n", "rtt(ms)", None, {}),
    "name without its unit": ("seq,rtt [us]\n0,20e3\n1,\n2,\n3,20000\n", "rtt", None, {}),
    "unit with a dash": ("seq,rtt_ms\n0,20\n1,\n2,\n3,20\n", "rtt_ms", None, {}),
    "unit at each number": ("seq,rtt\n0,20ms\n1,lost\n2,\n3,20000 us\n", "rtt", None, {}),
    "JSON lines": ('{"seq": 0, "rtt": 20.0}\n{"seq": 1}\n{"seq": 2, "rtt": null}\n{"seq": 3, "rtt": 20}\n', "rtt", "ms",
                   {"name": "loops.jsonl"}),
    "JSON": ('[{"a": {"rtt": 20}}, {"a": {"rtt": NaN}}, {"a": {}}, {"a": {"rtt": 20}}]', "a.rtt", "ms",
             {"name": "loops.json"}),
}  # fmt: skip


@pytest.mark.parametrize("case", GRAMMAR)
def test_what_tables_of_the_field_look_like(case: str, write: Callable[..., Path]) -> None:
    text, column, unit, more = GRAMMAR[case]
    expected = [0.02, math.inf, math.inf, 0.02]
    path = write(text, **more)
    np.testing.assert_allclose(read_trace(path, column, unit).delays, expected)
    packed = path.with_name(path.name + ".gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    np.testing.assert_allclose(read_trace(packed, column, unit).delays, expected)


def test_a_unit_is_asked_for_or_contradicted(write: Callable[..., Path]) -> None:
    with pytest.raises(ValueError, match=r"unit: got None for column 'rtt' of .*, which its name does not say"):
        read_trace(write("rtt\n1\n"), "rtt")
    with pytest.raises(ValueError, match=r"unit: got 's' for column 'rtt\(ms\)' of .*, expected 'ms', as it is called"):
        read_trace(write("rtt(ms)\n1\n"), "rtt", "s")
    with pytest.warns(UserWarning, match=r"half of the loops take less than 4.7 us"):
        read_trace(write("rtt\n" + 20 * "4.7\n"), "rtt", "us")
    with pytest.warns(UserWarning, match=r"half of the loops take more than 2e\+04 s in a recording of 1 s"):
        read_trace(write("rtt\n" + 20 * "20000\n"), "rtt", "s", period=0.05)


def test_send_times_may_be_timestamps(write: Callable[..., Path]) -> None:
    rows = "".join(f"2026-01-08 17:22:58.{123 + 50 * k:03d}456,1\n" for k in range(15))
    trace = read_trace(write("send_time,rtt\n" + rows), "rtt", "ms")
    assert trace.period == 0.05 and trace.period_from == "column 'send_time'"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (_histogram(("1ms", "1"), ("2ms", "3")), r"bin 2: has 3 delays but not two finite edges"),
        (_histogram(("-inf ms", "1"), ("2ms", "3"), ("3ms", "0")), r"bin 1: has 1 delays but not two finite edges"),
        (_histogram(("-1ms", "1"), ("2ms", "0")), r"bin 1: has a count below 0 s"),
        (_histogram(("2ms", "1"), ("1ms", "0")), r"bin 2: begins at 0.001 s, expected it above 0.002 s"),
        (_histogram(("2", "1"), ("3ms", "0")), r"bin 1: got low='2', expected a number and a unit"),
        (_histogram(("nan ms", "1"), ("3ms", "0")), r"bin 1: got low='nan ms'"),
        (_histogram(("2ms", "-1"), ("3ms", "0")), r"bin 1: got '-1', expected a count"),
        (_histogram(("2ms", "1_0"), ("3ms", "0")), r"bin 1: got '1_0', expected a count"),
        (_histogram(("2ms", "inf"), ("3ms", "0")), r"bin 1: got 'inf', expected a count"),
        ("[]", r"has no bin"),
        ('[{"count": 1}]', r"bin 1: expected lower_bound, upper_bound, count and unit"),
        ("[" * 100_000, r"loops.csv: cannot be read as JSON: it is nested too deep"),
        (_histogram(("2ms", "0"), ("3ms", "0")), r"has no count above 0"),
        (_histogram(), r"has 0 bins, expected two or more"),
        ("bin,count\n", r"loops.csv, line 1: is no XML and no bin such as"),
    ],
)
def test_histogram_errors_name_the_bin(write: Callable[..., Path], text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_histogram(write(text))
