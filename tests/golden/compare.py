#!/usr/bin/env python3
"""Compares the decisions of two runs, sample by sample and bit by bit: compare.py OLD.mcap NEW.mcap [OLD_FIELD=NEW_FIELD ..]

For use by hand when the golden run is recorded again because the layout of a message changed. It compares the fields that both definitions
name; `OLD_FIELD=NEW_FIELD` names a field that was renamed.
"""

import re
import sys

from mcap.reader import make_reader

SIZES = {"uint8": 1, "int8": 1, "uint16": 2, "int16": 2, "uint32": 4, "int32": 4, "float32": 4, "uint64": 8, "int64": 8, "float64": 8}


def fields(definition):
    """Name, offset and bytes of every field, nested ones by path; samples have no padding."""
    parts = re.split("={80}\nMSG: (.*)\n", definition)
    nested = dict(zip(parts[1::2], parts[2::2], strict=True))
    found = []

    def walk(text, path, offset):
        for line in text.splitlines():
            line = line.partition("#")[0].strip()
            if "=" in line or not line:
                continue
            kind, name = line.split()
            base, _, count = kind.partition("[")
            count = int(count.rstrip("]")) if count else None
            if base in SIZES:
                size = SIZES[base] * (count or 1)
                found.append((path + name, offset, size))
                offset += size
            else:
                for i in range(count or 1):
                    offset = walk(nested[base], f"{path}{name}{'' if count is None else i}.", offset)
        return offset

    walk(parts[0], "", 0)
    return {name: (offset, size) for name, offset, size in found}


def samples(path):
    with open(path, "rb") as file:
        channels = {}
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            layout, data = channels.setdefault(channel.topic, (fields(schema.data.decode()), []))
            data.append(message.data)
        return channels


old, new = (samples(path) for path in sys.argv[1:3])
renamed = dict(pair.split("=") for pair in sys.argv[3:])
for topic, (before, data) in old.items():
    old[topic] = ({renamed.get(name, name): place for name, place in before.items()}, data)
assert old.keys() == new.keys(), old.keys() ^ new.keys()
total, different = 0, 0
for topic in sorted(old):
    (before, one), (after, other) = old[topic], new[topic]
    assert len(one) == len(other), f"{topic}: {len(one)} and {len(other)} samples"
    common = [name for name in before if name in after and not name.split(".")[-1].startswith("pad")]
    # The head of a sample in the file: 4 bytes of CDR.
    off = [name for a, b in zip(one, other, strict=True) for name in common
           if a[4 + before[name][0]:][: before[name][1]] != b[4 + after[name][0]:][: after[name][1]]]
    total, different = total + len(one), different + len(off)
    left_out = sorted(before.keys() ^ after.keys())
    note = f", not in both: {', '.join(left_out[:6])}{' ..' if len(left_out) > 6 else ''}" if left_out else ""
    print(f"{topic:20} {len(one):6} samples, {len(common):4} fields each, {len(off)} differences{note}")
print(f"{total} samples compared, {different} differences")
sys.exit(different != 0)
