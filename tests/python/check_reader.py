"""Compares scripts/python/nims_run.py with the independent mcap-ros2-support: every sample, every field.

Argument: a run file, or a folder with the files of a run. What a later file repeats has to come once.
"""

import sys
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts" / "python"))
from nims_run import Run


def same(sample, message, where):
    compared = 0
    for field in sample.dtype.names:
        ours, theirs = sample[field], getattr(message, field)
        if isinstance(theirs, str):
            assert ours.decode() == theirs, f"{where}.{field}: {ours} and {theirs}"
            compared += 1
            continue
        if ours.dtype.names and ours.dtype.names[0] == "1":  # a list of elements that are not alike
            assert len(theirs) == len(ours.dtype.names), f"{where}.{field}"
            compared += sum(same(ours[name], other, f"{where}.{field}") for name, other in zip(ours.dtype.names, theirs, strict=True))
            continue
        if ours.dtype.names:
            pairs = [(ours, theirs)] if ours.ndim == 0 else zip(ours, theirs, strict=True)
            for one, other in pairs:
                compared += same(one, other, f"{where}.{field}")
            continue
        other = np.frombuffer(theirs, np.uint8) if isinstance(theirs, bytes) else np.asarray(theirs, dtype=ours.dtype)
        # Numbers, not bits: Python may change the payload bits of a NaN.
        equal = np.array_equal(ours, other, equal_nan=ours.dtype.kind == "f")
        assert equal, f"{where}.{field}: {ours} and {theirs}"
        compared += np.size(ours)
    return compared


begun = time.perf_counter()
run = Run(sys.argv[1])
ours = {name: run[name] for name in run.channels}
our_time = time.perf_counter() - begun

# In one pass, piece by piece, and from one time to another: the same samples.
together, bit_by_bit = run.read(), {}
for name, piece in run.pieces():
    bit_by_bit.setdefault(name, []).append(piece)
for name, samples in ours.items():
    assert together[name].tobytes() == samples.tobytes(), name
    times = np.concatenate([piece["log_time_ns"] for piece in bit_by_bit.get(name, [])] or [samples["log_time_ns"]])
    assert np.array_equal(np.sort(times), np.sort(samples["log_time_ns"])), name
    seconds = run.seconds(samples)
    begin_s, end_s = (np.quantile(seconds, share) for share in (0.3, 0.4)) if len(samples) else (0.0, 1.0)
    within = run.read(name, begin_s=begin_s, end_s=end_s)[name]
    assert len(within) == np.count_nonzero((seconds >= begin_s) & (seconds < end_s)), name

begun = time.perf_counter()
theirs, seen, repeated = {}, set(), 0
path = Path(sys.argv[1])
for file in sorted(path.glob("*.mcap"), key=lambda file: file.stem) if path.is_dir() else [path]:
    before, count = set(seen), 0
    with file.open("rb") as stream:
        for _, channel, message, decoded in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            key = (channel.topic, message.sequence, message.publish_time)
            seen.add(key)
            count += 1
            if key in before:
                repeated += 1
                continue
            theirs.setdefault(channel.topic.removeprefix("/"), []).append((message.log_time, decoded))
    with AnyReader([file]) as reader:  # each file of a run is one on its own for others
        assert sum(1 for _ in reader.messages()) == count, file
their_time = time.perf_counter() - begun

values = 0
for name, samples in ours.items():
    others = theirs.get(name, [])
    assert len(samples) == len(others), f"{name}: {len(samples)} samples and {len(others)}"
    fields = [field for field in samples.dtype.names if field != "log_time_ns"]
    for sample, (log_time, decoded) in zip(samples, others, strict=True):
        assert sample["log_time_ns"] == log_time, name
        values += same(sample[fields], decoded, name)
assert values > 0, "nothing was compared"
count = sum(map(len, ours.values()))
print(f"{repeated} repeated; {count} samples on {len(ours)} channels agree in {values} values; {their_time / our_time:.0f} times as fast as decoding one by one")
