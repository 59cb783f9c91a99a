"""Reads a run of nims into NumPy: every channel as one structured array, by its own definition in the file; all files of a run as one.

    from nims_run import Run
    run = Run("runs/2026-05-04T09-30-00Z-demo3")
    state = run["motor/state"]
    state["length_m"][:, 0]          # first cable, m
    run.seconds(state)               # s since the run began

Samples of nims are fixed-size, so nothing is decoded message by message: the message index of each chunk says where the samples
of a channel are, and they are taken out all at once. Needs `numpy`, `mcap` and `zstandard`.
"""

import mmap
import re
import struct
import warnings
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

# CDR as XCDR1 names its number types; `char` and `byte` are one byte.
PRIMITIVES = {
    "bool": "u1", "byte": "u1", "char": "u1",
    "uint8": "u1", "uint16": "<u2", "uint32": "<u4", "uint64": "<u8",
    "int8": "i1", "int16": "<i2", "int32": "<i4", "int64": "<i8",
    "float32": "<f4", "float64": "<f8",
}
# opcode, record length, channel, sequence, log time, publish time; then four bytes that say how the data are encoded
MESSAGE_HEAD = 1 + 8 + 2 + 4 + 8 + 8
CDR_HEAD = 4
# The end of that: a sample that a later file of the run repeats is known by its number and its sampling time.
TIMES = np.dtype([("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])
# Samples per channel in which a file may repeat what stands at the end of the one before.
REPEATS = 1024
RECOVERED = "-recovered"
FIELD = re.compile(r"^([A-Za-z][\w/]*)(?:\[(\d+)\])?\s+([a-z]\w*)$")
CONSTANT = re.compile(r"^(\w+)\s+([A-Z][A-Z0-9_]*)\s*=\s*(-?\d+)$")


class RunError(Exception):
    """What is wrong with a run, and what to do."""


class Definition:
    """A ROS 2 definition of fixed size: the NumPy type of a sample, and the names of values."""

    def __init__(self, text):
        own, *nested = re.split(r"^=+\n", text, flags=re.MULTILINE)
        texts = {}
        for part in nested:
            head, body = part.split("\n", 1)
            texts[head.removeprefix("MSG:").strip()] = body
        self.constants = {}
        self.dtype = self._parse(own, texts, record=True)

    def _parse(self, text, texts, record=False):
        fields, waiting = [], []
        for line in text.splitlines():
            line = line.split("#")[0].strip()
            if not line:
                continue
            constant = CONSTANT.match(line)
            if constant:
                waiting.append((constant[2], int(constant[3])))
                continue
            field = FIELD.match(line)
            if not field:
                raise RunError(f"the definition line `{line}` has no fixed size: read this channel with mcap-ros2-support")
            kind, count, name = field[1], field[2], field[3]
            dtype = np.dtype(PRIMITIVES[kind]) if kind in PRIMITIVES else self._parse(texts[kind], texts)
            fields.append((name, dtype, (int(count),)) if count else (name, dtype))
            if record and waiting:
                self.constants[name] = {value: label for label, value in waiting}
            waiting = []
        return np.dtype(fields)


class Run:
    """A run folder, or one run file."""

    def __init__(self, path):
        path = Path(path)
        self.files = _files_of(path) if path.is_dir() else [path]
        if not self.files:
            raise RunError(f"{path} holds no finished .mcap file: if the recorder was cut off, `nims recover {path}` restores it")
        for file in path.glob("*.mcap.part") if path.is_dir() else []:
            warnings.warn(f"{file} is not finished and left out: if nobody records it now, `nims recover {path}` restores it")
        self._maps, self._summaries, self.definitions, self.counts = [], [], {}, {}
        for file in self.files:
            with file.open("rb") as stream:
                summary = make_reader(stream).get_summary()
                if summary is None or summary.statistics is None:
                    raise RunError(f"{file} has no index: `nims recover {file}` makes one")
                self._maps.append(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
            self._summaries.append(summary)
            for number, channel in summary.channels.items():
                name = self._name_of(channel, summary.schemas[channel.schema_id])
                count = summary.statistics.channel_message_counts.get(number, 0)
                self.counts[name] = self.counts.get(name, 0) + count
        self.begin_ns = self._begin()
        self._chunks = {}

    def _begin(self):
        """When the recorder was started: the clock of the run."""
        with self.files[0].open("rb") as stream:
            about = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
        begin = about.get("run", {}).get("t0_unix_ns")
        return int(begin) if begin else min(summary.statistics.message_start_time for summary in self._summaries)

    def _name_of(self, channel, schema):
        """The name of a channel; behind an @ the hash of its type, if it had another type before."""
        name = channel.topic.removeprefix("/")
        if self.definitions.setdefault(name, schema).data != schema.data:
            name += "@" + (channel.metadata.get("type", "").rpartition("/")[2] or schema.name)
            self.definitions.setdefault(name, schema)
        return name

    @property
    def channels(self):
        """Names of the channels, e.g. `motor/state`."""
        return sorted(self.definitions)

    def definition(self, name):
        """What a sample of this channel is."""
        return Definition(self._schema(name).data.decode())

    def names(self, name, field):
        """The names of a field's values, e.g. `{0: "MODE_DISARMED", ..}`."""
        return self.definition(name).constants.get(field, {})

    def _schema(self, name):
        try:
            return self.definitions[name]
        except KeyError:
            raise RunError(f"no channel `{name}` in this run; there are {', '.join(self.channels)}") from None

    def __getitem__(self, name):
        """All samples of a channel in the order of their recording: a structured array; `log_time_ns` (UNIX time) comes first."""
        dtype = self.definition(name).dtype
        record = np.dtype([("log_time_ns", "<u8"), ("sample", dtype)])
        parts, before = [], []
        for file in range(len(self.files)):
            part, keys = self._of_file(file, name, record)
            new = np.ones(len(part), bool)
            known = set(before)
            new[:REPEATS] = [key not in known for key in keys[:REPEATS].tolist()]
            parts.append(part[new])
            before = (before + keys[new][-REPEATS:].tolist())[-REPEATS:]
        whole = np.concatenate([part for part in parts if len(part)] or [np.zeros(0, record)])
        whole = whole[np.argsort(whole["log_time_ns"], kind="stable")]
        flat = np.dtype([("log_time_ns", "<u8")] + [(field, *_type(dtype, field)) for field in dtype.names])
        return whole.view(flat)

    def _of_file(self, file, name, record):
        summary, data = self._summaries[file], self._maps[file]
        numbers = [n for n, c in summary.channels.items() if self._name_of(c, summary.schemas[c.schema_id]) == name]
        size = record["sample"].itemsize
        span = np.arange(size)
        parts, keys = [], []
        for chunk in summary.chunk_indexes:
            for number in numbers:
                if number not in chunk.message_index_offsets:
                    continue
                entries = _index(data, chunk.message_index_offsets[number])
                raw = self._chunk(file, chunk)
                begins = entries["offset"].astype(np.int64) + MESSAGE_HEAD + CDR_HEAD
                if begins.max() + size > len(raw):
                    raise RunError(f"{self.files[file]}: samples of `{name}` are shorter than their definition says")
                part = np.empty(len(entries), record)
                part["log_time_ns"] = entries["log_time"]
                part["sample"] = raw[begins[:, None] + span].view(record["sample"])[:, 0]
                parts.append(part)
                heads = raw[(begins - CDR_HEAD - TIMES.itemsize)[:, None] + np.arange(TIMES.itemsize)].view(TIMES)[:, 0]
                keys.append(heads[["sequence", "publish_time"]])
        if not parts:
            return np.zeros(0, record), np.zeros(0, TIMES)
        return np.concatenate(parts), np.concatenate(keys)

    def _chunk(self, file, chunk):
        key = (file, chunk.chunk_start_offset)
        if key not in self._chunks:
            # A few chunks are remembered: the channels of a run are usually read one after the other.
            if len(self._chunks) >= 512:
                self._chunks.clear()
            self._chunks[key] = _uncompressed(self._maps[file], chunk)
        return self._chunks[key]

    def seconds(self, samples):
        """When each sample was recorded, s since the run began."""
        return (samples["log_time_ns"].astype(np.int64) - self.begin_ns) * 1e-9

    def columns(self, name, numbers_from=1):
        """A channel as plain columns, `length_m_1` and so on for arrays; for `pandas.DataFrame` or `polars.DataFrame`."""
        samples = self[name]
        columns = {"t_s": self.seconds(samples)}
        _spread(samples, "", columns, numbers_from)
        del columns["log_time_ns"]
        return columns


def _files_of(folder):
    """In the order of their writing; where a damaged file has been recovered, that one in its place."""
    files = {file.stem: file for file in folder.glob("*.mcap")}
    bare = {stem.removesuffix(RECOVERED): stem for stem in sorted(files)}  # `run-recovered` comes behind `run`
    return [files[bare[stem]] for stem in sorted(bare)]


def _type(dtype, field):
    kind = dtype[field]
    return (kind.base, kind.shape) if kind.shape else (kind,)


def _index(data, offset):
    length = struct.unpack_from("<I", data, offset + 1 + 8 + 2)[0]
    entry = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
    return np.frombuffer(data, entry, length // entry.itemsize, offset + 1 + 8 + 2 + 4)


def _uncompressed(data, chunk):
    # opcode, length, start time, end time, uncompressed size, CRC, name of the compression
    at = chunk.chunk_start_offset + 1 + 8 + 8 + 8 + 8 + 4
    at += 4 + struct.unpack_from("<I", data, at)[0]
    length = struct.unpack_from("<Q", data, at)[0]
    body = data[at + 8 : at + 8 + length]
    if chunk.compression == "zstd":
        import zstandard

        body = zstandard.ZstdDecompressor().decompress(body, max_output_size=chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        import lz4.frame

        body = lz4.frame.decompress(body)
    elif chunk.compression:
        raise RunError(f"chunks are compressed with {chunk.compression}: read this file with the mcap package")
    return np.frombuffer(body, np.uint8)


def _spread(samples, prefix, columns, first):
    for field in samples.dtype.names:
        column, name = samples[field], f"{prefix}{field}"
        if column.dtype.names:
            nested = [column] if column.ndim == 1 else column.T
            for number, part in enumerate(nested):
                label = name if column.ndim == 1 else f"{name}_{number + first}"
                _spread(part, "" if label == "header" else f"{label}_", columns, first)
        elif re.fullmatch(r"pad\d+", field):
            continue
        elif column.ndim == 1:
            columns[name] = column
        else:
            for number in range(column.shape[1]):
                columns[f"{name}_{number + first}"] = column[:, number]
