"""Nav2's parameter files: a user's own read and written, an advice in Nav2 and ROS 2 names."""

from qocjax.nav2.advised import advised
from qocjax.nav2.facts import Fact, fact, facts
from qocjax.nav2.fragment import nav2_text
from qocjax.nav2.options import stack_options, to_options
from qocjax.nav2.read import NavParams, Plugin, read_params
from qocjax.nav2.write import Change, merged

__all__ = [
    "Change",
    "Fact",
    "NavParams",
    "Plugin",
    "advised",
    "fact",
    "facts",
    "merged",
    "nav2_text",
    "read_params",
    "stack_options",
    "to_options",
]
