#!/usr/bin/env bash
# ROS 2 Kilted from PyPI (ros-rclpy 9.1.2), Python 3.11 to 3.13: where warnings are errors no node can be made. Every node has
# parameter services, whose messages import `rosidl_generator_py` for their type support; that imports the whole code generator
# with its parser of interface files, and so lark-parser 0.12, which imports `sre_parse`, deprecated since Python 3.11. Test
# suites with `filterwarnings = error` need an exception for it; a Python without `sre_parse` would have no rclpy.
#
# Fails if that changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet "ros-rclpy==9.1.2" "ros-rmw-fastrtps-cpp==9.3.3"
cat >"$work/node.py" <<'PYTHON'
import sys

import rclpy

rclpy.init()
print("before a node:", "lark" in sys.modules)
node = rclpy.create_node("alone")
print("with a node:", "lark" in sys.modules, "rosidl_generator_py" in sys.modules)
node.destroy_node()
rclpy.shutdown()
PYTHON
export ROS_AUTOMATIC_DISCOVERY_RANGE=OFF
usual=$("$work/venv/bin/python" "$work/node.py")
echo "$usual"
[ "$usual" = $'before a node: False\nwith a node: True True' ]
if strict=$("$work/venv/bin/python" -W error "$work/node.py" 2>&1); then
  echo "no warning any more"
  exit 1
fi
echo "with -W error: $(tail -n 1 <<<"$strict")"
grep -q "DeprecationWarning: module 'sre_parse' is deprecated" <<<"$strict"
