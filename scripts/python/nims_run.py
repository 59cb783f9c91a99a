"""Reads a run of nims into NumPy: every channel of all files as one structured array, by its definition in the file.

    from nims_run import Run
    run = Run("runs/2026-05-04T09-30-00Z-demo3")
    state = run["motor/state"]
    state["length_m"][:, 0]          # first cable, m
    run.seconds(state)               # s since the run began

Samples of nims have a fixed size, so they are not decoded one by one: the message index of each chunk locates the
samples of a channel, and they are copied at once. Messages of the visualization process are read too: their texts become
bytes, their lists arrays. Needs `numpy`, `mcap` and `zstandard`.
"""

import itertools
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
# opcode, record length, channel, sequence, log time, publish time; then four bytes for the encoding
MESSAGE_HEAD = 1 + 8 + 2 + 4 + 8 + 8
CDR_HEAD = 4
# The end of that head: a sample that a later file repeats is identified by its number and its publish time.
TIMES = np.dtype([("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])
# Samples per channel at the start of a file that may repeat the end of the previous file.
REPEATS = 1024
RECOVERED = "-recovered"
FIELD = re.compile(r"^([A-Za-z][\w/]*)(?:\[(\d*)\])?\s+([a-z]\w*)$")
# Position of the record's length before a message's times; bytes of the record beside the data.
LENGTH_AT, LENGTH_HEAD = 8 + 2 + 4 + 8 + 8, 2 + 4 + 8 + 8 + CDR_HEAD
CONSTANT = re.compile(r"^(\w+)\s+([A-Z][A-Z0-9_]*)\s*=\s*(-?\d+)$")


class RunError(Exception):
    """One sentence: what is wrong with a run, and what to do."""


class Definition:
    """A ROS 2 definition: the NumPy type of a sample, and the names of values.

    If it has texts or lists, `body` is a sample, and the type is that of samples with texts and lists of the same lengths;
    `lengths` are the positions of these lengths.
    """

    def __init__(self, text, body=None):
        self.text = text
        own, *nested = re.split(r"^=+\n", text, flags=re.MULTILINE)
        self._texts = {}
        for part in nested:
            head, rest = part.split("\n", 1)
            self._texts[head.removeprefix("MSG:").strip()] = rest
        self.constants, self.lengths = {}, []
        self.is_fixed = not any(_is_open(lines, self._texts) for lines in (own, *self._texts.values()))
        if not self.is_fixed and body is None:
            raise RunError("a definition with texts or lists has no type without a sample")
        self._body = None if self.is_fixed else bytes(body)
        self.dtype, _, _ = self._struct(own, 0, record=True)

    def _struct(self, text, at, record=False):
        """The type of a struct placed at or after `at`, where it begins, and where it ends."""
        begin, names, types, offsets, waiting = 0 if record else None, [], [], [], []
        for line in _lines(text):
            constant = CONSTANT.match(line)
            if constant:
                waiting.append((constant[2], int(constant[3])))
                continue
            field = FIELD.match(line)
            if not field:
                raise RunError(f"the definition line `{line}` is not in the form that nims writes: read this channel with mcap-ros2-support")
            kind, count, name = field[1], field[2], field[3]
            dtype, start, at = self._field(kind, count, at)
            if record and waiting:
                self.constants[name] = {value: label for label, value in waiting}
            waiting = []
            if dtype is None:
                continue  # an empty list
            begin = start if begin is None else begin
            names.append(name), types.append(dtype), offsets.append(start - begin)
        begin = at if begin is None else begin
        layout = {"names": names, "formats": types, "offsets": offsets, "itemsize": at - begin}
        return np.dtype(layout), begin, at

    def _field(self, kind, count, at):
        if count == "":
            at, many = self._length(at)
            return self._array(kind, many, at) if many else (None, at, at)
        return self._array(kind, int(count), at) if count else self._one(kind, at)

    def _one(self, kind, at):
        if kind == "string":
            at, length = self._length(at)
            # with its terminating zero, which NumPy omits
            return (np.dtype(f"S{length}"), at, at + length) if length else (None, at, at)
        if kind in PRIMITIVES:
            dtype = np.dtype(PRIMITIVES[kind])
            # in memory as in CDR: every number at a multiple of its own size
            at = -(-at // dtype.itemsize) * dtype.itemsize
            return dtype, at, at + dtype.itemsize
        return self._struct(self._texts[kind], at)

    def _array(self, kind, many, at):
        elements, end = [], at
        for _ in range(many if kind not in PRIMITIVES else 1):
            dtype, start, end = self._one(kind, end)
            elements.append((dtype, start))
        first, begin = elements[0]
        if kind in PRIMITIVES:
            return np.dtype((first, (many,))), begin, begin + many * first.itemsize
        strides = {later[1] - earlier[1] for earlier, later in itertools.pairwise(elements)}
        if all(dtype == first for dtype, _ in elements) and strides <= {first.itemsize}:
            return np.dtype((first, (many,))), begin, end
        # of different shapes: each is named by its number
        named = {"names": [str(n + 1) for n in range(many)], "formats": [dtype for dtype, _ in elements],
                 "offsets": [start - begin for _, start in elements], "itemsize": end - begin}
        return np.dtype(named), begin, end

    def _length(self, at):
        at = -(-at // 4) * 4
        self.lengths.append(at)
        return at + 4, struct.unpack_from("<I", self._body, at)[0]


def _lines(text):
    lines = (line.split("#")[0].strip() for line in text.splitlines())
    return [line for line in lines if line]


def _is_open(text, texts):
    """Whether a type itself contains texts or lists."""
    fields = [FIELD.match(line) for line in _lines(text) if not CONSTANT.match(line)]
    return any(field and (field[1] == "string" or field[2] == "") for field in fields)


class Run:
    """A run folder, or one run file."""

    def __init__(self, path):
        path = Path(path)
        self.files = _files_of(path) if path.is_dir() else [path]
        if not self.files:
            raise RunError(f"{path} holds no finished .mcap file: if the recorder was cut off, `nims recover {path}` restores it")
        for file in path.glob("*.mcap.part") if path.is_dir() else []:
            warnings.warn(
                f"{file} is not finished and is skipped: unless it is being recorded, `nims recover {path}` restores it",
                stacklevel=2,
            )
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
        """The start of the recorder, from which the run counts, UNIX ns."""
        with self.files[0].open("rb") as stream:
            about = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
        begin = about.get("run", {}).get("t0_unix_ns")
        return int(begin) if begin else min(summary.statistics.message_start_time for summary in self._summaries)

    def _name_of(self, channel, schema):
        """The name of a channel, followed by @ and the hash of its type if it had another type before."""
        name = channel.topic.removeprefix("/")
        known = self.definitions.setdefault(name, schema).data
        if known != schema.data and _lines(known.decode()) != _lines(schema.data.decode()):
            name += "@" + (channel.metadata.get("type", "").rpartition("/")[2] or schema.name)
            self.definitions.setdefault(name, schema)
        return name

    @property
    def channels(self):
        """Names of the channels, e.g. `motor/state`."""
        return sorted(self.definitions)

    def definition(self, name):
        """The definition of this channel's samples."""
        text = self._schema(name).data.decode()
        if not any(_is_open(part, {}) for part in re.split(r"^=+\n(?:MSG:.*\n)?", text, flags=re.MULTILINE)):
            return Definition(text)
        for file in range(len(self.files)):
            for raw, begins, _ in self._messages(file, name):
                return Definition(text, raw[begins[0] : begins[0] + _body_bytes(raw, begins)[0]])
        raise RunError(f"`{name}` has texts or lists but no samples, so their lengths are unknown")

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
        definition = self.definition(name)
        parts, before = [], []
        for file in range(len(self.files)):
            part, keys = self._of_file(file, name, definition)
            new = np.ones(len(part), bool)
            known = set(before)
            new[:REPEATS] = [key not in known for key in keys[:REPEATS].tolist()]
            parts.append(part[new])
            before = (before + keys[new][-REPEATS:].tolist())[-REPEATS:]
        whole = _joined([part for part in parts if len(part)] or parts[:1])
        whole = whole[np.argsort(whole["log_time_ns"], kind="stable")]
        return whole.view(_flat(whole.dtype))

    def _messages(self, file, name):
        """For each chunk with samples of a channel: its bytes, where their bodies begin, and their index entries."""
        summary, data = self._summaries[file], self._maps[file]
        numbers = [n for n, c in summary.channels.items() if self._name_of(c, summary.schemas[c.schema_id]) == name]
        for chunk in summary.chunk_indexes:
            for number in numbers:
                if number in chunk.message_index_offsets:
                    entries = _index(data, chunk.message_index_offsets[number])
                    yield self._chunk(file, chunk), entries["offset"].astype(np.int64) + MESSAGE_HEAD + CDR_HEAD, entries

    def _of_file(self, file, name, definition):
        parts, keys = [], []
        for raw, begins, entries in self._messages(file, name):
            pieces, places = [], []
            for alike, which in _groups(definition, raw, begins):
                record = np.dtype([("log_time_ns", "<u8"), ("sample", alike.dtype)])
                size = alike.dtype.itemsize
                if begins[which].max() + size > len(raw):
                    raise RunError(f"{self.files[file]}: samples of `{name}` are shorter than their definition")
                piece = np.empty(len(which), record)
                piece["log_time_ns"] = entries["log_time"][which]
                bodies = raw[begins[which][:, None] + np.arange(size)]
                piece["sample"] = np.ascontiguousarray(bodies).view(alike.dtype)[:, 0]
                pieces.append(piece), places.append(which)
            parts.append(_joined(pieces, places))
            heads = raw[(begins - CDR_HEAD - TIMES.itemsize)[:, None] + np.arange(TIMES.itemsize)].view(TIMES)[:, 0]
            keys.append(heads[["sequence", "publish_time"]])
        if not parts:
            return np.zeros(0, np.dtype([("log_time_ns", "<u8"), ("sample", definition.dtype)])), np.zeros(0, TIMES)
        return _joined(parts), np.concatenate(keys)

    def _chunk(self, file, chunk):
        key = (file, chunk.chunk_start_offset)
        if key not in self._chunks:
            # Cached, because the channels of a run are usually read one after the other.
            if len(self._chunks) >= 512:
                self._chunks.clear()
            self._chunks[key] = _uncompressed(self._maps[file], chunk)
        return self._chunks[key]

    def seconds(self, samples):
        """Time of each sample, s since the run began."""
        return (samples["log_time_ns"].astype(np.int64) - self.begin_ns) * 1e-9

    def columns(self, name, numbers_from=1):
        """A channel as plain columns, `length_m_1` and so on for arrays; for `pandas.DataFrame` or `polars.DataFrame`."""
        samples = self[name]
        columns = {"t_s": self.seconds(samples)}
        _spread(samples, "", columns, numbers_from)
        del columns["log_time_ns"]
        return columns


def _files_of(folder):
    """The files in the order of writing; a recovered file replaces its damaged original."""
    files = {file.stem: file for file in folder.glob("*.mcap")}
    bare = {stem.removesuffix(RECOVERED): stem for stem in sorted(files)}  # `run-recovered` sorts after `run`
    return [files[bare[stem]] for stem in sorted(bare)]


def _joined(parts, places=None):
    """Concatenates parts, or puts each at its places. Texts take the longest length; fields keep their offsets if possible."""
    kinds = {part.dtype for part in parts}
    if len(kinds) > 1:
        try:
            kinds = {np.result_type(*kinds)}
        except TypeError as problem:
            raise RunError(f"samples have lists of different lengths, so read this channel with mcap-ros2-support: {problem}") from None
    whole, at = np.empty(sum(map(len, parts)), kinds.pop()), 0
    for number, part in enumerate(parts):
        whole[places[number] if places else slice(at, at + len(part))] = part
        at += len(part)
    return whole


def _groups(definition, raw, begins):
    """Groups of samples whose texts and lists have the same lengths, with their indices."""
    rest = np.arange(len(begins))
    if definition.is_fixed:
        yield definition, rest
        return
    sizes = _body_bytes(raw, begins)
    while len(rest):
        first = rest[0]
        alike = Definition(definition.text, raw[begins[first] : begins[first] + sizes[first]])
        words = np.add.outer(alike.lengths, np.arange(4)).ravel()
        same = rest[sizes[rest] == sizes[first]]
        same = same[(raw[begins[same][:, None] + words] == raw[begins[first] + words]).all(axis=1)]
        yield alike, same
        rest = np.setdiff1d(rest, same)


def _body_bytes(raw, begins):
    """Size of each sample in bytes, from the length of its record."""
    words = raw[(begins - CDR_HEAD - LENGTH_AT)[:, None] + np.arange(8)]
    return words.copy().view("<u8")[:, 0].astype(np.int64) - LENGTH_HEAD


def _flat(record):
    """The type of a record with the sample's fields beside its time."""
    sample, at = record["sample"], record.fields["sample"][1]
    return np.dtype({
        "names": ["log_time_ns", *sample.names],
        "formats": [record["log_time_ns"], *(sample[field] for field in sample.names)],
        "offsets": [0, *(at + sample.fields[field][1] for field in sample.names)],
        "itemsize": record.itemsize,
    })


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
