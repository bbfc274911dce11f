"""A table reads the same with pyarrow and without: values, types, times and every sentence."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzz_logs import mutate
from hypothesis import HealthCheck, event, example, given, settings
from hypothesis import strategies as st
from log_samples import FIGURE_TEXT, assert_drives_equal

from jaxradar._errors import LogError
from jaxradar.drive import Drive
from jaxradar.labcsv import read_lab_csv
from jaxradar.labcsv.parse import by_pyarrow, by_python
from jaxradar.labcsv.table import Table, read_table

SOUND = st.one_of(
    st.integers(0, 65535).map(lambda count: b"%d.000000" % count),
    st.integers(-9, 70000).map(lambda count: b"%d" % count),
    st.floats(allow_nan=False, allow_infinity=False).map(lambda value: repr(value).encode()),
    st.from_regex(rb"[+-]?([0-9]{1,30}(\.[0-9]{0,30})?|\.[0-9]{1,30})([eE][+-]?[0-9]{1,2})?", fullmatch=True),
    st.sampled_from([b" 1\t", b"+.5", b"5.", b"-0", b"4.9e-324", b"1e-400", b"0.1" + b"3" * 400, b"9007199254740993"]),
)
ODD = st.one_of(
    st.sampled_from([b"", b" ", b"nan", b"-NaN", b"nan(1)", b"NAN()", b"inf", b"+Infinity", b"1e999", b"9" * 400]),
    st.sampled_from([b"1_0", b"1e", b".", b"0x10", b"1d5", b"--1", b"1 2", b'"1"', b"\xff", b"1\0", b"n", b"#1"]),
    st.sampled_from([b"\r", b"1\r", b"\r1", b"1\r2", b"\x0b1", b"\x0c", b"1\x1c", b"\xc2\xa01", "١".encode(), b"1,2"]),
    st.binary(max_size=4),
)


TIMES = st.one_of(
    st.integers(0, 10**6).map(lambda count: b"%d.%06d" % divmod(count * 3333, 10**6)),
    st.integers(0, 3 * 10**18).map(lambda time_ns: b"%d.%09d" % divmod(time_ns, 10**9)),  # float64 does not hold them
    st.floats(-1e6, 1e6).map(lambda seconds: repr(seconds).encode()),
)


def texts(
    times: st.SearchStrategy[bytes], cells: st.SearchStrategy[bytes], ends: list[bytes]
) -> st.SearchStrategy[tuple[int, bytes]]:
    """Numbers a row beside the time, and rows of them as text."""

    def of(columns: int) -> st.SearchStrategy[tuple[int, bytes]]:
        numbers = st.lists(cells, min_size=columns, max_size=columns).map(b",".join)
        row = st.tuples(times, st.just(b","), numbers, st.sampled_from(ends)).map(b"".join)
        return st.lists(row, min_size=1, max_size=6).map(lambda rows: (columns, b"".join(rows)))

    return st.integers(1, 4).flatmap(of)


def outcome(read: Callable[[], Any]) -> Any:
    try:
        return read()
    except LogError as error:
        return str(error), error.line, error.column


def both(read: Callable[[], Any]) -> tuple[Any, Any]:
    """What comes out with pyarrow and without: a result, or what is said and where."""
    fast = outcome(read)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "pyarrow", None)
        return fast, outcome(read)


def assert_same_table(columns: int, text: bytes, **allowed: bool) -> Table | None:
    fast, plain = both(lambda: read_table(Path("3.csv"), text, 0, columns, first_line=2, **allowed))
    if not isinstance(fast, Table):
        assert fast == plain
        return None
    assert isinstance(plain, Table), plain
    for name, wanted in asdict(fast).items():
        found = getattr(plain, name)
        if name == "problems":
            assert found == wanted
            continue
        assert found.dtype == wanted.dtype, name
        np.testing.assert_array_equal(found, wanted, err_msg=name)
        known = ~np.isnan(wanted)
        np.testing.assert_array_equal(np.signbit(found[known]), np.signbit(wanted[known]), err_msg=name)
    return plain


MODES = st.sampled_from([{}, {"alone": True}, {"holes": True}])


@settings(max_examples=400, deadline=None)
@given(table=texts(TIMES, SOUND, [b"\n", b"\r\n"]), mode=MODES)
def test_both_read_sound_tables_alike(table: tuple[int, bytes], mode: dict[str, bool]) -> None:
    assert assert_same_table(*table, **mode) is not None


@settings(max_examples=800, deadline=None)
@given(
    table=texts(
        TIMES | TIMES | ODD,
        st.one_of(SOUND, SOUND, SOUND, ODD),
        [*[b"\n"] * 6, b"\r\n", b"\r\r\n", b"\r", b"\n\n", b",\n", b"\0"],
    ),
    mode=MODES,
)
@example((1, b"0,1\n1,nan(2)\n2,3"), {"holes": True})
@example((1, b"0,1\r\r\n1,2\r\r\n2,3\r\r\n"), {})
@example((2, b"0,1\r2,3\n0,1,2"), {"alone": True})
@example((1, b"0,1\n,2\n2,x\n"), {"holes": True})
@example((1, b"0,1\n\n2,3\n"), {"holes": True})
@example((1, b"0,1\n\n2"), {})
def test_both_read_damaged_tables_alike(table: tuple[int, bytes], mode: dict[str, bool]) -> None:
    event("read" if assert_same_table(*table, **mode) else "refused")


NAMED = "time_s,acceleration_m_s2,speed_m_s\n" + "".join(
    f"{0.01 * row:.3f},{row - 3},{'8.5' * (row % 2)}\n" for row in range(9)
)


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32), part=st.sampled_from(["3.csv", "gyro.csv", "acc.csv"]))
def test_both_read_damaged_logs_alike(seed: int, part: str, tmp_path: Path) -> None:
    content = {"3.csv": FIGURE_TEXT, "gyro.csv": "0.012,3\n0.032,-4\n0.052,127\n0.072,0\n", "acc.csv": NAMED}
    (tmp_path / "acc.csv").unlink(missing_ok=True)
    for name in ("3.csv", "gyro.csv", part):
        (tmp_path / name).write_text(content[name])
    (tmp_path / part).write_bytes(mutate(content[part].encode(), random.Random(seed)))
    fast, plain = both(lambda: read_lab_csv(tmp_path))
    if isinstance(fast, Drive):
        assert isinstance(plain, Drive), plain
        assert_drives_equal(plain, fast)
    else:
        assert fast == plain


@pytest.mark.parametrize(("last", "dtype"), [(b"%d.000000", np.uint16), (b"%d.5", np.float64)])
def test_both_read_tables_of_many_blocks_alike(last: bytes, dtype: type) -> None:
    """More than either parses at once, the last number alone of another kind."""
    rows, columns = 400, 511
    counts = np.random.default_rng(3).integers(0, 60_000, (rows, columns))
    lines = [
        b"%d.%06d,%s" % (row, row, b",".join(b"%d.000000" % count for count in counts[row])) for row in range(rows)
    ]
    lines[-1] = lines[-1].rpartition(b",")[0] + b"," + last % counts[-1, -1]
    table = assert_same_table(columns, b"\n".join(lines) + b"\n")
    assert table is not None
    assert table.values.dtype == dtype
    np.testing.assert_array_equal(np.floor(table.values), counts)
    np.testing.assert_array_equal(table.times_ns, np.arange(rows) * 1_000_001_000)


def test_pyarrow_is_asked_where_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    text = b"0,1\n1,2.5"
    wanted = [[0.0, 1.0], [1.0, 2.5]]
    (block,) = by_pyarrow(text, 0, len(text), 2, holes=False) or ()
    assert block.tolist() == wanted
    (block,) = by_python(text.split(b"\n"), 2, holes=False) or ()
    assert block.tolist() == wanted
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert by_pyarrow(text, 0, len(text), 2, holes=False) is None
