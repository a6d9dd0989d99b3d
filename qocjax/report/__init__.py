"""Pages to look at: one self-contained HTML file for a study, or for several studies compared."""

from qocjax.report.comparison import write_comparison_report
from qocjax.report.content import study_page
from qocjax.report.hall import HallMap, hall_map
from qocjax.report.replay import Replay
from qocjax.report.study import StudyPage, write_study_report

__all__ = ["HallMap", "Replay", "StudyPage", "hall_map", "study_page", "write_comparison_report", "write_study_report"]
