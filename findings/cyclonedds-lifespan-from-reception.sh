#!/usr/bin/env bash
# Eclipse Cyclone DDS 11.0.1: a reader counts a sample's LIFESPAN from its reception, not from its source timestamp. Samples
# whose source timestamp lies 150 ms back are handed over under a lifespan of 100 ms, all of them, with that timestamp; those
# that lie unread for 150 ms are dropped. DDS 1.4 (section 2.2.3.16) lets a sample expire at its source timestamp plus the
# duration where clocks are in step. So a lifespan does not keep a late command from a robot.
#
# Fails if that changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet "cyclonedds==11.0.1"
cat >"$work/lifespan.py" <<'PYTHON'
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Sample(IdlStruct, typename="Sample"):
    number: int


lifespan = Policy.Lifespan(duration(milliseconds=100))
qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100), lifespan)
participant = DomainParticipant(77)
topic = Topic(participant, "samples", Sample)
reader, writer = DataReader(participant, topic, qos=qos), DataWriter(participant, topic, qos=qos)
for number in range(20):
    writer.write(Sample(number), timestamp=time.time_ns() - 150_000_000)
got = reader.take(N=100)
ages = [(time.time_ns() - each.sample_info.source_timestamp) * 1e-6 for each in got]
print("late:", len(got), "of 20, all older than 149 ms:", min(ages, default=0.0) > 149.0)
for number in range(20):
    writer.write(Sample(number))
time.sleep(0.15)
print("unread:", len(reader.take(N=100)), "of 20")
PYTHON
export CYCLONEDDS_URI="<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces><AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>"
seen=$("$work/venv/bin/python" "$work/lifespan.py")
echo "$seen"
[ "$seen" = $'late: 20 of 20, all older than 149 ms: True\nunread: 0 of 20' ]
