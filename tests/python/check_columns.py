"""Compares the ways in which scripts/python/nims_run.py reads a run, in files of each compression and in damaged ones.

Argument: a run file, or a folder with the files of a run. The samples are those of the independent `mcap`, byte by byte.
"""

import os
import sys
import tempfile
import warnings
from pathlib import Path
from unittest import mock

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts" / "python"))
import nims_run
from nims_run import Run, RunError

# Small enough for many chunks, of which many channels have more than a block.
CHUNK_BYTES = 16 * 2**10


def write_again(source, target, compression):
    """The same messages in another file, by code that is not ours."""
    with source.open("rb") as stream, target.open("wb") as copy:
        reader, writer = make_reader(stream), Writer(copy, chunk_size=CHUNK_BYTES, compression=compression)
        writer.start()
        schemas, channels = {}, {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                of = channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                channels[channel.id] = writer.register_channel(*of)
            data = message.data, message.publish_time, message.sequence
            writer.add_message(channels[channel.id], message.log_time, *data)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()


def theirs(folder):
    """Log times and bodies of the samples of each channel, in the order of recording, without what a file repeats."""
    seen, samples = set(), {}
    for file in sorted(folder.glob("*.mcap"), key=lambda file: file.stem):
        before = set(seen)
        with file.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                key = (channel.topic, message.sequence, message.publish_time)
                seen.add(key)
                if key not in before:
                    of = samples.setdefault(channel.topic.removeprefix("/"), [])
                    of.append(np.uint64(message.log_time).tobytes() + message.data[nims_run.CDR_HEAD :])
    return {name: b"".join(of) for name, of in samples.items()}


def result(read, name):
    """What a way of reading returns, or the kind of its error."""
    try:
        return read(name).tobytes()
    except Exception as problem:
        return type(problem)


def same_each_way(folder, expected=None):
    """Compares what `run[name]` returns as the first pass of a run, from the cache, from the temporary file and without a
    place for one, and what `pieces` returns. How many channels are in the file, and how many bytes are as expected.
    """
    compared = 0
    first = {name: result(lambda name: Run(folder)[name], name) for name in Run(folder).channels}
    one_by_one = Run(folder)
    try:
        nims_run.CACHE_BYTES, kept = 0, nims_run.CACHE_BYTES
        from_file, without_file = Run(folder), Run(folder)
        with mock.patch.dict(os.environ, TMPDIR="/nowhere"):
            for name, samples in first.items():
                assert result(without_file.__getitem__, name) == samples, f"{folder}: {name}"
        assert not without_file._columns
        for name, samples in first.items():
            for run in (one_by_one, from_file, from_file):
                assert result(run.__getitem__, name) == samples, f"{folder}: {name}"
            # Texts and lists have another type in each piece, and check_reader.py compares them.
            if nims_run.has_texts_or_lists(from_file.definitions[name].data.decode()) or isinstance(samples, type):
                continue
            of_pieces = [piece for _, piece in Run(folder).pieces(name)]
            if of_pieces:
                joined = np.concatenate(of_pieces)
                assert joined[np.argsort(joined["log_time_ns"], kind="stable")].tobytes() == samples, f"{folder}: {name} in pieces"
            else:
                assert samples == b"", f"{folder}: {name} in pieces"
            if expected is not None:
                assert samples == expected.get(name, b""), f"{folder}: {name} is not what mcap reads"
                compared += len(samples)
        columns = len(from_file._columns)
        # What is written to an array is in no other one.
        for name in list(from_file._columns)[:1]:
            array = from_file[name]
            array["log_time_ns"] = 0
            assert from_file[name].tobytes() == first[name]
            del from_file
            assert not array["log_time_ns"].any(), "an array outlives its run"
    finally:
        nims_run.CACHE_BYTES = kept
    return columns, compared


source = Path(sys.argv[1])
files = sorted(source.glob("*.mcap")) if source.is_dir() else [source]
warnings.simplefilter("error")
for name, compression in [("none", CompressionType.NONE), ("lz4", CompressionType.LZ4), ("zstd", CompressionType.ZSTD)]:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for file in files:
            write_again(file, folder / file.name, compression)
        expected = theirs(folder)
        columns, compared = same_each_way(folder, expected)
        assert columns and compared, "nothing was compared"
        print(f"{name}: {compared} bytes of {columns} channels agree")

        # Blocks of any size give the same file.
        largest = nims_run.BLOCK_BYTES
        for nims_run.BLOCK_BYTES in (1, 1000, 2**40) if name == "zstd" else ():
            assert same_each_way(folder, expected) == (columns, compared)
        nims_run.BLOCK_BYTES = largest

        # A chunk whose beginning was overwritten: each way ends in the same samples or the same kind of error.
        file = folder / files[-1].name
        whole = file.read_bytes()
        with file.open("rb") as stream:
            chunks = make_reader(stream).get_summary().chunk_indexes
        middle = chunks[len(chunks) // 2]
        at = middle.chunk_start_offset + middle.chunk_length - middle.compressed_size
        file.write_bytes(whole[:at] + bytes(16) + whole[at + 16 :])
        of_damaged, _ = same_each_way(folder)
        assert name == "none" or not of_damaged, "the damage was not met"

        # A file that was cut off has no index: it is refused as a whole, with the cure.
        for share in (0.2, 0.9, 0.999):
            file.write_bytes(whole[: int(share * len(whole))])
            try:
                Run(folder)
            except RunError as problem:
                assert "nims recover" in str(problem), problem
            else:
                raise AssertionError(f"{share} of a file was read")
