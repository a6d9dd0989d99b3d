"""Recorded runs: bags of ROS 2 and logs of loops in, loop traces and quality of control out (model, section 10)."""

from qocjax.recorded.findings import CAUSES, Findings
from qocjax.recorded.folder import Labels, find_runs
from qocjax.recorded.judge import Quality, Yardstick
from qocjax.recorded.loops import ClockRules, LoopTrace
from qocjax.recorded.run import RecordedRun, Rules, RunFiles, read_run
from qocjax.recorded.series import Cleaning
from qocjax.recorded.stamps import StampsFormat
from qocjax.recorded.topics import TopicPatterns

__all__ = [
    "CAUSES",
    "Cleaning",
    "ClockRules",
    "Findings",
    "Labels",
    "LoopTrace",
    "Quality",
    "RecordedRun",
    "Rules",
    "RunFiles",
    "StampsFormat",
    "TopicPatterns",
    "Yardstick",
    "find_runs",
    "read_run",
]
