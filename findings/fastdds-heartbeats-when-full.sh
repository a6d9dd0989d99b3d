#!/usr/bin/env bash
# ROS 2 Kilted from PyPI with its default middleware (rmw_fastrtps_cpp 9.3.3, Fast DDS 3.2.3): how soon a RELIABLE reader can
# learn that a sample was lost hangs on the history. At 50 Hz over loopback a KEEP_LAST(10) publisher sends a heartbeat with
# every eleventh sample or so, when its history is full of samples that nobody has acknowledged yet; KEEP_ALL's history is never
# full, so it sends one every 3 s (the default heartbeat period) and nothing shows a gap before. On a link that loses
# packets KEEP_ALL therefore stalls for seconds, where KEEP_LAST(10) repairs within 0.2 s; Eclipse Cyclone DDS puts a heartbeat
# on every sample. A heartbeat_period of the sampling period in the writers' XML profile makes them alike.
#
# Counts the heartbeats on the loopback device of a network namespace of its own: needs Linux, ip, and root or user namespaces.
# Fails if that changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet "ros-rclpy==9.1.2" "ros-rmw-fastrtps-cpp==9.3.3" "ros-std-msgs"
cat >"$work/node.py" <<'PYTHON'
import sys
import time

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

role, depth = sys.argv[1], int(sys.argv[2])
history = HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL
qos = QoSProfile(history=history, depth=depth, reliability=ReliabilityPolicy.RELIABLE)
rclpy.init()
node = rclpy.create_node(role, enable_rosout=False, start_parameter_services=False)
if role == "listener":
    got = []
    node.create_subscription(String, "chatter", got.append, qos)
    while len(got) < 400:
        rclpy.spin_once(node, timeout_sec=0.1)
    time.sleep(0.5)
else:
    publisher = node.create_publisher(String, "chatter", qos)
    while not publisher.get_subscription_count():
        time.sleep(0.05)
    time.sleep(0.5)
    for k in range(400):
        publisher.publish(String(data="x" * 100))
        time.sleep(0.02)
    time.sleep(1.0)
node.destroy_node()
rclpy.shutdown()
PYTHON
cat >"$work/count.py" <<'PYTHON'
import socket
import struct
import subprocess
import sys
import threading
from collections import Counter

KINDS = {0x07: (4, "heartbeats"), 0x15: (8, "samples")}
counts = Counter()
sniffer = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0800))


def listen():
    while True:
        packet = sniffer.recv(65536)
        at = 4 * (packet[0] & 0x0F) + 8
        if packet[at : at + 4] != b"RTPS":
            continue
        at += 20
        while at + 4 <= len(packet):
            kind, size = packet[at], struct.unpack("<H", packet[at + 2 : at + 4])[0]
            offset, name = KINDS.get(kind, (0, ""))
            writer = packet[at + 4 + offset : at + 8 + offset]
            if name and writer[3] & 0xC0 == 0:  # of user data
                counts[writer, name] += 1
            if size == 0:
                break
            at += 4 + size


threading.Thread(target=listen, daemon=True).start()
both = [subprocess.Popen([sys.executable, sys.argv[1], role, sys.argv[2]]) for role in ("listener", "talker")]
assert [each.wait(60) for each in both] == [0, 0]
(writer, _), _ = max(((key, count) for key, count in counts.items() if key[1] == "samples"), key=lambda each: each[1])
print(counts[writer, "samples"], counts[writer, "heartbeats"])
PYTHON
cat >"$work/room.sh" <<'ROOM'
ip link set lo up multicast on
ip route add 224.0.0.0/4 dev lo
exec "$@"
ROOM
export RMW_IMPLEMENTATION=rmw_fastrtps_cpp FASTDDS_BUILTIN_TRANSPORTS=UDPv4 ROS_LOG_DIR="$work"
unset FASTDDS_DEFAULT_PROFILES_FILE FASTRTPS_DEFAULT_PROFILES_FILE
count() { unshare -rn bash "$work/room.sh" "$work/venv/bin/python" "$work/count.py" "$work/node.py" "$1"; }
read -r samples heartbeats <<<"$(count 10)"
echo "KEEP_LAST(10): $samples samples in 8 s, $heartbeats heartbeats"
[ "$samples" -ge 400 ] && [ "$heartbeats" -ge 20 ] && [ "$heartbeats" -le 80 ]
read -r samples heartbeats <<<"$(count 0)"
echo "KEEP_ALL: $samples samples in 8 s, $heartbeats heartbeats"
[ "$samples" -ge 400 ] && [ "$heartbeats" -le 5 ]
