"""Reads a run of nims into NumPy: every channel of all files as one structured array, by its definition in the file.

    from nims_run import Run
    run = Run("runs/2026-05-04T09-30-00Z-demo3")
    state = run["motor/state"]
    state["length_m"][:, 0]          # first cable, m
    run.seconds(state)               # s since the run began

    run.read("motor/state", "truth/node", begin_s=30, end_s=40)    # several channels in one pass
    for name, samples in run.pieces():                             # a run of any length in little memory
        ...

Samples of nims have a fixed size, so they are not decoded one by one: the message index of each chunk locates the
samples of a channel, and they are copied at once. Messages of the visualization process are read too: their texts become
bytes, their lists arrays. Needs `numpy`, `mcap` and `zstandard`.

Nearly every chunk of a file contains every channel, so what takes time is a pass over the file, which uncompresses the
chunks: about 0.3 s for each million samples. `read` and `pieces` take one pass for any number of channels; `run[name]`
takes two passes for all channels one after the other, with a temporary file (see there).
"""

import functools
import itertools
import mmap
import os
import re
import shutil
import struct
import tempfile
import threading
import warnings
from collections import OrderedDict, deque
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
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
# An index: opcode, record length, channel, bytes of the entries; then the entries.
INDEX_HEAD = 1 + 8 + 2 + 4
ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
# Samples per channel at the start of a file that may repeat the end of the previous file.
REPEATS = 1024
RECOVERED = "-recovered"
# Names that a recorder or a recovery gives, without their ending.
RUN_FILE = re.compile(r"run(-\d+)?(-recovered)?")
FIELD = re.compile(r"^([A-Za-z][\w/]*)(?:\[(\d*)\])?\s+([a-z]\w*)$")
# Chunks of a pass are kept uncompressed if they are not longer, bytes: the channels of a short run are usually read one
# after the other. Of a longer pass, none would be left for the next one.
CACHE_BYTES = 64 * 2**20
# Position of the record's length before a message's times; bytes of the record beside the data.
LENGTH_AT, LENGTH_HEAD = 8 + 2 + 4 + 8 + 8, 2 + 4 + 8 + 8 + CDR_HEAD
# Largest block in which a column of a temporary file is written, bytes, and most pieces in it; 64 of the largest blocks
# wait at most. The kernel takes half as long for blocks that begin at multiples of their size as for small pieces.
BLOCK_BYTES, BLOCK_PIECES = 2**20, 256
CONSTANT = re.compile(r"^(\w+)\s+([A-Z][A-Z0-9_]*)\s*=\s*(-?\d+)$")


class RunError(Exception):
    """One sentence: what is wrong with a run, and what to do."""


def has_texts_or_lists(text):
    """Whether samples of this ROS 2 definition differ in size."""
    return any(_is_open(part, {}) for part in re.split(r"^=+\n(?:MSG:.*\n)?", text, flags=re.MULTILINE))


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
        self.record = np.dtype([("log_time_ns", "<u8"), ("sample", self.dtype)])

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
        for file in path.glob("run*.mcap.part") if path.is_dir() else []:
            warnings.warn(
                f"{file} is not finished and is skipped: unless it is being recorded, `nims recover {path}` restores it",
                stacklevel=2,
            )
        self._descriptors, self._summaries, self.definitions, self.counts = [], [], {}, {}
        self._numbers, self._cache, self._cached_bytes = [], OrderedDict(), 0
        self._lock = threading.Lock()  # for programs that read a run in several threads
        self._storing = threading.Lock()
        self._first, self._columns = None, None
        for file in self.files:
            with file.open("rb") as stream:
                try:
                    summary = make_reader(stream).get_summary()
                except (McapError, struct.error, ValueError, OSError) as problem:
                    raise RunError(f"{file} cannot be read as MCAP ({problem}): `nims recover {file}` restores what it holds") from None
                if summary is None or summary.statistics is None:
                    raise RunError(f"{file} has no index: `nims recover {file}` makes one")
                self._descriptors.append(os.dup(stream.fileno()))
            self._summaries.append(summary)
            numbers = {}
            for number, channel in summary.channels.items():
                name = self._name_of(channel, summary.schemas[channel.schema_id])
                numbers.setdefault(name, []).append(number)
                count = summary.statistics.channel_message_counts.get(number, 0)
                self.counts[name] = self.counts.get(name, 0) + count
            self._numbers.append(numbers)
        self.begin_ns = self._begin()

    def __del__(self):
        for descriptor in getattr(self, "_descriptors", []):
            os.close(descriptor)

    def _begin(self):
        """The start of the recorder, from which the run counts, UNIX ns."""
        for file in self.files:
            with file.open("rb") as stream:
                about = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
            # A file that a power cut emptied has none.
            if begin := about.get("run", {}).get("t0_unix_ns"):
                return int(begin)
        begins = [summary.statistics.message_start_time for summary in self._summaries if summary.statistics.message_count]
        return min(begins, default=0)

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
        text = self._text(name)
        if not has_texts_or_lists(text):
            return Definition(text)
        for file in range(len(self.files)):
            for chunk, entries_of in self._chunks(file, [name], lambda _: True):
                begins = _begins(entries_of[name])
                return Definition(text, chunk[begins[0] : begins[0] + _body_bytes(chunk, begins)[0]])
        raise RunError(f"`{name}` has texts or lists but no samples, so their lengths are unknown")

    def names(self, name, field):
        """The names of a field's values, e.g. `{0: "MODE_DISARMED", ..}`."""
        return self.definition(name).constants.get(field, {})

    def _text(self, name):
        try:
            return self.definitions[name].data.decode()
        except KeyError:
            raise RunError(f"no channel `{name}` in this run; there are {', '.join(self.channels)}") from None

    def __getitem__(self, name):
        """All samples of a channel in the order of their recording: a structured array; `log_time_ns` (UNIX time) comes first.

        The first channel takes a pass. For the second one, a run that does not fit into the cache takes a longer pass, which
        copies all channels to a temporary file; from then on they are mapped into memory from there, without a pass. The file
        has no name and ends with the run and its arrays. It gets up to a quarter of the memory's size and half of the free
        space of `TMPDIR` (default: /var/tmp, because /tmp may be in memory). A channel that has no place in it, or has texts
        or lists, takes a pass of its own each time.
        """
        self._text(name)
        with self._storing:
            if self._columns is None and self._first not in (None, name):
                chunks = [chunk for summary in self._summaries for chunk in summary.chunk_indexes]
                is_long = sum(chunk.uncompressed_size for chunk in chunks) > CACHE_BYTES
                self._columns = self._stored_columns() if is_long else {}
            self._first = self._first or name
        column = (self._columns or {}).get(name)
        return _ordered(column.samples()) if column else self.read(name)[name]

    def _stored_columns(self):
        """Channels of fixed size as columns of a temporary file, the smallest ones first; none if one cannot be read."""
        columns, end, folder = {}, 0, os.environ.get("TMPDIR") or "/var/tmp"
        try:
            descriptor, path = tempfile.mkstemp(dir=folder)
        except OSError:
            return {}
        os.unlink(path)
        self._descriptors.append(descriptor)
        most = min(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 4, shutil.disk_usage(folder).free // 2)
        try:
            fixed = [name for name in self.channels if self.counts[name] and not has_texts_or_lists(self._text(name))]
            definitions = {name: self.definition(name) for name in fixed}
            block = BLOCK_BYTES >> (len(fixed) // 64).bit_length()
            for name in sorted(fixed, key=lambda name: self.counts[name] * definitions[name].record.itemsize):
                column = _Column(descriptor, end, definitions[name].record, self.counts[name], block)
                if column.end <= most:
                    columns[name], end = column, column.end
            if end and hasattr(os, "posix_fallocate"):
                os.posix_fallocate(descriptor, 0, end)
            for name, piece in self._pieces(list(columns), definitions, None, None, None):
                columns[name].append(piece)
            for column in columns.values():
                column.write()
        except BaseException as problem:
            self._descriptors.remove(descriptor)
            os.close(descriptor)
            # The pass of each channel on its own raises what concerns it.
            if not isinstance(problem, Exception):
                raise
            return {}
        return {name: column for name, column in columns.items() if column.filled}

    def read(self, *names, begin_s=None, end_s=None):
        """Samples of these channels (default: of all) from `begin_s` until before `end_s`, as a dictionary of arrays.

        One pass over the run, however many channels it reads. Of all, those whose samples have lists of different lengths,
        such as pictures, are left out with a warning.
        """
        left_out = None if names else set()
        names = names or self.channels
        definitions, whole, filled = {}, {}, dict.fromkeys(names, 0)
        for name in names:
            self._text(name)
            if self.counts[name]:
                definitions[name] = self.definition(name)
                if definitions[name].is_fixed:
                    # The system gives an array its memory where it is first written to. Bytes are copied several times
                    # as fast as fields.
                    whole[name] = np.empty(self.counts[name], np.dtype((np.void, definitions[name].record.itemsize)))
        lists = {name: [] for name in names if name not in whole}
        for name, piece in self._pieces(names, definitions, begin_s, end_s, left_out):
            if name in whole:
                whole[name][filled[name] : filled[name] + len(piece)] = piece.view(whole[name].dtype)
                filled[name] += len(piece)
            else:
                lists[name].append(piece)
        read = {name: _shortened(samples, filled[name]).view(definitions[name].record) for name, samples in whole.items()}
        for name, pieces in lists.items():
            if left_out and name in left_out:
                continue
            try:
                read[name] = self._open(name, pieces)
            except RunError as problem:
                _leave_out(name, problem, left_out)
        return {name: _ordered(read[name]) for name in names if not left_out or name not in left_out}

    def pieces(self, *names, begin_s=None, end_s=None):
        """The same samples bit by bit: pairs of a channel's name and an array, one for each chunk of the file.

        For runs that are larger than the memory. Samples of a channel are in the order of writing. Pictures and the like are
        left out as by `read`.
        """
        left_out = None if names else set()
        names = names or self.channels
        definitions = {name: self.definition(name) for name in names if self.counts.get(name, 1)}
        for name, piece in self._pieces(names, definitions, begin_s, end_s, left_out):
            yield name, piece.view(_flat(piece.dtype))

    def _open(self, name, pieces):
        """Joins the pieces of a channel that has texts or lists, or no samples."""
        if pieces:
            return _joined(pieces)
        return np.zeros(0, self.definition(name).record)

    def _pieces(self, names, definitions, begin_s, end_s, left_out):
        """For each chunk and each channel in it: the records of its samples, without those that a file repeats. Channels whose
        samples have no common type are added to `left_out`; where that is None, they are an error.
        """
        begin_ns, end_ns = (None if at is None else self.begin_ns + round(at * 1e9) for at in (begin_s, end_s))

        def within(chunk):
            return not (begin_ns and chunk.message_end_time < begin_ns or end_ns and chunk.message_start_time >= end_ns)

        past = {name: _Past() for name in names} if len(self.files) > 1 else {}
        for file in range(len(self.files)):
            # A later file may repeat what an earlier one holds before the wanted time.
            ends = self._ends(file, names) if begin_ns and file + 1 < len(self.files) else ()
            for one in past.values():
                one.next_file()
            for chunk, entries_of in self._chunks(file, names, lambda c, e=ends: within(c) or c.chunk_start_offset in e):
                for name, entries in entries_of.items():
                    if left_out and name in left_out:
                        continue
                    try:
                        piece = _records(definitions[name], chunk, entries, f"{self.files[file]}: samples of `{name}`")
                    except RunError as problem:
                        _leave_out(name, problem, left_out)
                        continue
                    keep = past[name].are_new(_keys(chunk, entries)) if past else True
                    if begin_ns or end_ns:
                        keep &= (entries["log_time"] >= (begin_ns or 0)) & (entries["log_time"] < (end_ns or 2**63))
                    yield name, piece if keep is True or keep.all() else piece[keep]

    def _ends(self, file, names):
        """Where the chunks begin that hold the last samples of these channels in a file: those that a later file may repeat."""
        begins = set()
        for name in names:
            left = REPEATS
            for number in self._numbers[file].get(name, ()):
                for chunk in reversed(self._summaries[file].chunk_indexes):
                    offset = chunk.message_index_offsets.get(number)
                    if offset and left > 0:
                        begins.add(chunk.chunk_start_offset)
                        head = os.pread(self._descriptors[file], INDEX_HEAD, offset)
                        left -= struct.unpack_from("<I", head, INDEX_HEAD - 4)[0] // ENTRY.itemsize
        return begins

    def _chunks(self, file, names, wanted):
        """Chunks with samples of these channels, uncompressed, and the index entries of each channel in them."""
        numbers = {number: name for name in names for number in self._numbers[file].get(name, ())}
        chunks = [
            chunk
            for chunk in self._summaries[file].chunk_indexes
            if wanted(chunk) and not numbers.keys().isdisjoint(chunk.message_index_offsets)
        ]
        keep = sum(chunk.uncompressed_size for chunk in chunks) <= CACHE_BYTES
        # Memory of its own for each chunk costs a tenth of a pass.
        space = None if keep else np.empty(max(chunk.uncompressed_size for chunk in chunks), np.uint8)
        for chunk in chunks:
            raw, index = self._chunk(file, chunk, space)
            entries_of = {}
            for number, offset in sorted(chunk.message_index_offsets.items(), key=lambda item: item[1]):
                if number in numbers:
                    entries = _index(index, offset - chunk.chunk_start_offset - chunk.chunk_length)
                    if not len(entries):
                        continue
                    known = entries_of.get(numbers[number])
                    entries_of[numbers[number]] = entries if known is None else np.concatenate((known, entries))
            yield raw, entries_of

    def _chunk(self, file, chunk, space):
        """The uncompressed records of a chunk, and the index behind it: in this space, or else kept for the next pass."""
        key = (file, chunk.chunk_start_offset)
        with self._lock:
            if key in self._cache:
                self._cache.move_to_end(key)
                return self._cache[key]
        length = chunk.chunk_length + chunk.message_index_length
        stored = os.pread(self._descriptors[file], length, chunk.chunk_start_offset)
        if len(stored) < length:
            raise RunError(f"{self.files[file]} ends within a chunk: `nims recover {self.files[file]}` restores it")
        ready = _uncompressed(stored, chunk, space), stored[chunk.chunk_length :]
        if len(ready[0]) < chunk.uncompressed_size:
            raise RunError(f"{self.files[file]} has a chunk that is cut off: `nims recover {self.files[file]}` restores the others")
        with self._lock:
            if space is None and key not in self._cache:
                self._cache[key] = ready
                self._cached_bytes += len(ready[0])
            while self._cached_bytes > CACHE_BYTES and len(self._cache) > 1:
                _, (oldest, _) = self._cache.popitem(last=False)
                self._cached_bytes -= len(oldest)
        return ready

    def seconds(self, samples):
        """Time of each sample, s since the run began."""
        return (samples["log_time_ns"].astype(np.int64) - self.begin_ns) * 1e-9

    def columns(self, name, numbers_from=1):
        """A channel as plain columns, `length_m_1` and so on for arrays; for `pandas.DataFrame` or `polars.DataFrame`.

        A field of the name of an earlier column, such as `t_s`, gets a `_` behind it.
        """
        samples = self[name]
        columns = {"t_s": self.seconds(samples)}
        _spread(samples, "", columns, numbers_from)
        del columns["log_time_ns"]
        return columns


def _files_of(folder):
    """The files in the order of writing; a recovered file replaces its damaged original. Other files beside them, such as a
    drawing of the run, are no part of it.
    """
    files = {file.stem: file for file in folder.glob("*.mcap")}
    of_run = {stem: file for stem, file in files.items() if RUN_FILE.fullmatch(stem)}
    files = of_run or files
    bare = {stem.removesuffix(RECOVERED): stem for stem in sorted(files)}  # `run-recovered` sorts after `run`
    return [files[bare[stem]] for stem in sorted(bare)]


def _leave_out(name, problem, left_out):
    """Leaves a channel out with a warning; an error if it was asked for by name."""
    if left_out is None:
        raise RunError(f"`{name}`: {problem}") from None
    left_out.add(name)
    warnings.warn(f"`{name}` is left out: {problem}", stacklevel=4)


def _joined(parts, places=None):
    """Concatenates parts, or puts each at its places. Texts take the longest length; fields keep their offsets if possible."""
    kinds = {part.dtype for part in parts}
    if len(kinds) > 1:
        try:
            kinds = {np.result_type(*kinds)}
        except TypeError as problem:
            raise RunError(f"samples have lists of different lengths, so read this channel with mcap-ros2-support: {problem}") from None
    # Zeros, so that what lies between fields is the same each time.
    whole, at = np.zeros(sum(map(len, parts)), kinds.pop()), 0
    for number, part in enumerate(parts):
        whole[places[number] if places else slice(at, at + len(part))] = part
        at += len(part)
    return whole


def _groups(definition, raw, begins):
    """Groups of samples whose texts and lists have the same lengths, with their indices."""
    if definition.is_fixed:
        yield definition, slice(None)
        return
    rest, sizes = np.arange(len(begins)), _body_bytes(raw, begins)
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


@functools.lru_cache(maxsize=1024)
def _flat(record):
    """The type of a record with the sample's fields beside its time."""
    sample, at = record["sample"], record.fields["sample"][1]
    names = ["log_time_ns"]
    for field in sample.names:
        names.append(_free(field, names))
    return np.dtype({
        "names": names,
        "formats": [record["log_time_ns"], *(sample[field] for field in sample.names)],
        "offsets": [0, *(at + sample.fields[field][1] for field in sample.names)],
        "itemsize": record.itemsize,
    })


class _Column:
    """The samples of a channel in a temporary file, from a border of pages on; written in blocks."""

    def __init__(self, descriptor, begin, record, most, block):
        self.descriptor, self.begin, self.record, self.most, self.block = descriptor, begin, record, most, block
        self.end = begin + -(-most * record.itemsize // mmap.ALLOCATIONGRANULARITY) * mmap.ALLOCATIONGRANULARITY
        self.filled, self._written, self._waiting = 0, begin, []

    def append(self, piece):
        self.filled += len(piece)
        if self.filled > self.most:
            raise RunError("there are more samples than the file counts")
        self._waiting.append(piece.view(np.uint8))
        end = self.begin + self.filled * self.record.itemsize
        if end // self.block > self._written // self.block:
            self.write(end % self.block)
        elif len(self._waiting) == BLOCK_PIECES:
            self.write()

    def write(self, beyond=0):
        """Writes what waits, except the last bytes, which are beyond the border of a block."""
        if not self._waiting:
            return
        last = self._waiting.pop()
        here, later = np.split(last, [len(last) - beyond])
        self._waiting.append(here)
        length = sum(map(len, self._waiting))
        if os.pwritev(self.descriptor, self._waiting, self._written) < length:
            raise OSError("no space left")
        self._written += length
        self._waiting = [later]

    def samples(self):
        """An array on a map of its own: what is written to it does not get into the file."""
        stored = mmap.mmap(self.descriptor, self.filled * self.record.itemsize, access=mmap.ACCESS_COPY, offset=self.begin)
        return np.frombuffer(stored, self.record)


class _Past:
    """The last samples of a channel in earlier files, with which the next file may begin again."""

    def __init__(self):
        self.last, self.before, self.looked = deque(maxlen=REPEATS), frozenset(), 0

    def next_file(self):
        self.before, self.looked = frozenset(self.last), 0

    def are_new(self, keys):
        """For each sample: whether no earlier file has it."""
        new = np.ones(len(keys), bool)
        if self.before and self.looked < REPEATS:
            first = keys[: REPEATS - self.looked].tolist()
            new[: len(first)] = [key not in self.before for key in first]
            self.looked += len(first)
        self.last.extend(keys[new][-REPEATS:].tolist())
        return new


def _shortened(samples, count):
    """The first `count` samples, without the memory of the others if they are many."""
    return samples[:count] if 2 * count > len(samples) else samples[:count].copy()


def _ordered(samples):
    """Samples in the order of recording, with their fields beside the time."""
    times = samples["log_time_ns"]
    if (times[1:] < times[:-1]).any():
        samples = samples[np.argsort(times, kind="stable")]
    return samples.view(_flat(samples.dtype))


def _index(data, at):
    """The entries of a message index that begins at `at`."""
    length = struct.unpack_from("<I", data, at + INDEX_HEAD - 4)[0]
    return np.frombuffer(data, ENTRY, length // ENTRY.itemsize, at + INDEX_HEAD)


def _begins(entries):
    """Where the bodies of samples begin in their chunk."""
    return entries["offset"].astype(np.int64) + (MESSAGE_HEAD + CDR_HEAD)


def _cut(raw, begins, size):
    """Pieces of `size` bytes that begin at these places, copied."""
    # Each place of the chunk is an element as long as a piece, so that NumPy copies a piece at once.
    windows = np.ndarray(len(raw) - size + 1, np.dtype((np.void, size)), raw, strides=(1,))
    return windows[begins]


def _keys(raw, entries):
    """What identifies samples that a later file repeats."""
    heads = _cut(raw, _begins(entries) - CDR_HEAD - TIMES.itemsize, TIMES.itemsize).view(TIMES)
    return heads[["sequence", "publish_time"]]


def _records(definition, raw, entries, what):
    """Times and samples of a channel in one chunk."""
    begins = _begins(entries)
    pieces, places = [], []
    for alike, which in _groups(definition, raw, begins):
        size, at = alike.dtype.itemsize, begins[which]
        if len(at) and at.max() + size > len(raw):
            raise RunError(f"{what} are shorter than their definition")
        record = alike.record
        # The bytes before a sample get the time.
        piece = _cut(raw, at - (record.itemsize - size), record.itemsize).view(record)
        piece["log_time_ns"] = entries["log_time"][which]
        pieces.append(piece), places.append(which)
    return pieces[0] if len(pieces) == 1 else _joined(pieces, places)


def _uncompressed(stored, chunk, space):
    # opcode, length, start time, end time, uncompressed size, CRC, name of the compression
    at = 1 + 8 + 8 + 8 + 8 + 4
    at += 4 + struct.unpack_from("<I", stored, at)[0]
    length = struct.unpack_from("<Q", stored, at)[0]
    body = memoryview(stored)[at + 8 : at + 8 + length]
    if chunk.compression == "zstd":
        import zstandard

        space = np.empty(chunk.uncompressed_size, np.uint8) if space is None else space[: chunk.uncompressed_size]
        with zstandard.ZstdDecompressor().stream_reader(body) as reader:
            return space[: reader.readinto(space)]
    elif chunk.compression == "lz4":
        import lz4.frame

        body = lz4.frame.decompress(body)
    elif chunk.compression:
        raise RunError(f"chunks are compressed with {chunk.compression}: read this file with the mcap package")
    return np.frombuffer(body, np.uint8)


def _free(name, taken):
    """The name, or as `nims export` names a field whose name is taken."""
    while name in taken:
        name += "_"
    return name


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
            columns[_free(name, columns)] = column
        else:
            for number in range(column.shape[1]):
                columns[_free(f"{name}_{number + first}", columns)] = column[:, number]
