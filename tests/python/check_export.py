"""Compares exported tables with what independent readers find in the run files. Arguments: the run folder, the folder with the tables.

The run is decoded message by message by mcap-ros2-support. The tables are read by the csv module, by NumPy, and by DuckDB, which knows Parquet from
others than us. Numbers are compared by their bits, but for the bits of a NaN, which text has not.
"""

import csv
import math
import re
import struct
import sys
from pathlib import Path

import duckdb
import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

TEXT_BYTES = 16
run, tables = Path(sys.argv[1]), Path(sys.argv[2])


def text_of(raw):
    end = raw.find(b"\0")
    head, rest = (raw, b"") if end < 0 else (raw[:end], raw[end:])
    try:
        text = head.decode()
        if not rest.strip(b"\0") and all(c in "\n\t" or not (ord(c) < 32 or 127 <= ord(c) < 160) for c in text):
            return text
    except UnicodeDecodeError:
        pass
    return "0x" + raw.hex()


def flatten(message, prefix=""):
    """Name and value of every column, by the names that decoded messages have."""
    for field in message.__slots__:
        value, name = getattr(message, field), f"{prefix}{field}"
        if re.fullmatch(r"pad\d+", field):
            continue
        if hasattr(value, "__slots__") and not isinstance(value, (bytes, list, tuple)):
            yield from flatten(value, "" if name == "header" else f"{name}_")
        elif isinstance(value, (bytes, bytearray, memoryview)) and (len(value) >= TEXT_BYTES or field == "data"):
            yield name, text_of(bytes(value))
        elif isinstance(value, (list, tuple, bytes, bytearray, memoryview, np.ndarray)):
            for number, element in enumerate(value, 1):
                if hasattr(element, "__slots__"):
                    yield from flatten(element, f"{name}_{number}_")
                else:
                    yield f"{name}_{number}", element
        else:
            yield name, value


def same(ours, theirs):
    if isinstance(theirs, str):
        return ours == theirs
    if isinstance(theirs, float):
        if math.isnan(theirs):
            return math.isnan(float(ours))
        equal = struct.pack("<d", float(ours)) == struct.pack("<d", theirs)
        # the shortest text of a 32-bit number is that number again only as one of 32 bits
        single = isinstance(ours, str) and abs(theirs) < 3.4e38 and float(np.float32(theirs)) == theirs
        return equal or single and np.float32(ours).tobytes() == np.float32(theirs).tobytes()
    return int(ours) == int(theirs)


expected, seen, begin_ns = {}, {}, None
for file in sorted(run.glob("*.mcap"), key=lambda file: file.stem):
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        about = {record.name: record.metadata for record in reader.iter_metadata()}
        begin_ns = int(about["run"]["t0_unix_ns"])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            name = channel.topic.removeprefix("/")
            key = (message.sequence, message.publish_time)
            if key in seen.setdefault(name, set()):
                continue
            seen[name].add(key)
            row = {"log_time_ns": message.log_time, "publish_time_ns": message.publish_time, **dict(flatten(decoded))}
            expected.setdefault(name, []).append(row)

values = 0
for channel, rows in expected.items():
    stem = channel.replace("/", ".")
    with (tables / f"{stem}.csv").open(newline="") as stream:
        from_csv = list(csv.DictReader(stream))
    relation = duckdb.sql(f"select * from read_parquet('{tables / stem}.parquet')")
    columns, from_parquet = relation.columns, relation.fetchall()
    from_numpy = np.load(tables / f"{stem}.npy", mmap_mode="r")
    assert len(from_csv) == len(from_parquet) == len(from_numpy) == len(rows), f"{channel}: {len(rows)} samples"
    assert list(from_csv[0]) == columns, f"{channel}: {list(from_csv[0])} and {columns}"
    assert set(columns) == {"t_s", *rows[0]}, f"{channel}: {set(columns) ^ {'t_s', *rows[0]}}"
    for number, row in enumerate(rows):
        where = f"{channel} sample {number}"
        parquet = dict(zip(columns, from_parquet[number], strict=True))
        t_s = (row["log_time_ns"] - begin_ns) * 1e-9
        assert abs(float(from_csv[number]["t_s"]) - t_s) < 2e-9 and abs(parquet["t_s"] - t_s) < 1e-9, where
        for name, value in row.items():
            assert same(from_csv[number][name], value), f"{where}.{name} in CSV: {from_csv[number][name]}, not {value}"
            assert same(parquet[name], value), f"{where}.{name} in Parquet: {parquet[name]}, not {value}"
            values += 1
        for name in from_numpy.dtype.names:
            field = from_numpy[number][name]
            if not re.search(r"(^|_)pad\d+$", name) and field.ndim == 0:
                assert same(field, row[name]), f"{where}.{name} in NumPy: {field}, not {row[name]}"
            elif name in row:
                assert text_of(field.tobytes()) == row[name], f"{where}.{name} in NumPy"
            elif f"{name}_1" in row:
                for at, element in enumerate(field, 1):
                    assert same(element, row[f"{name}_{at}"]), f"{where}.{name} in NumPy"
assert values > 0
print(f"{sum(map(len, expected.values()))} samples on {len(expected)} channels agree in {values} values of three formats")
