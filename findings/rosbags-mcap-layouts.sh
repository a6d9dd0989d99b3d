#!/usr/bin/env bash
# rosbags 0.11.9 reads less than there is of two layouts that MCAP allows.
#
# The format: channel records need not be repeated in the summary (mcap.dev/spec: all of the summary is optional), and
# messages need not be in the order of their log times. rosbag2 writes the first with noRepeatedChannels, the second with
# its preset fastwrite (no chunks) whenever two topics reach the recorder a little out of order.
# Seen, 100 messages in each file: without repeated channels it finds no topic and no message, and raises nothing; without
# chunks and with records 20 and 21 exchanged it raises "Unindexed MCAP messages are not in timestamp order" on the way.
# Exits with 0 if that is so, with 1 if it has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q rosbags==0.11.9 mcap==1.6.0
cat > "$work/check.py" <<'PY'
import sys
from pathlib import Path
from mcap.writer import Writer
from rosbags.rosbag2 import Reader

def write(path, order, **options):
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        channel = writer.register_channel("/beat", "cdr", schema)
        for k in order:
            writer.add_message(channel, 10**18 + k * 10**7, b"\x00\x01\x00\x00\x00", 10**18 + k * 10**7, k)
        writer.finish()

def read(path):
    with Reader(path) as reader:
        return [c.topic for c in reader.connections], sum(1 for _ in reader.messages())

folder = Path(sys.argv[1])
swapped = [*range(20), 21, 20, *range(22, 100)]
write(folder / "plain.mcap", range(100))
write(folder / "swapped_chunked.mcap", swapped)
write(folder / "no_repeats.mcap", range(100), repeat_channels=False)
write(folder / "swapped_unchunked.mcap", swapped, use_chunking=False)
found = {}
for name in ("plain", "swapped_chunked", "no_repeats", "swapped_unchunked"):
    try:
        found[name] = read(folder / f"{name}.mcap")
    except Exception as error:
        found[name] = f"{type(error).__name__}: {error}"
    print(f"{name}: {found[name]}, of 100 messages of /beat")
whole = (["/beat"], 100)
assert found["plain"] == whole and found["swapped_chunked"] == whole, "the plain files are not read either"
sys.exit(0 if found["no_repeats"] == ([], 0) and "not in timestamp order" in found["swapped_unchunked"] else 1)
PY
"$work/venv/bin/python" "$work/check.py" "$work"
