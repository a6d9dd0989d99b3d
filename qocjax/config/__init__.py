"""The typed schema of every configuration, and the one place where a configuration becomes objects.

Hydra composes the YAML files of `conf/`; the models here reject an unknown key and a wrong type; their `build` methods
turn them into scenarios, designs, rules and networks. After that no configuration travels.
"""

from qocjax.config.part import Part, conf_dir, load
from qocjax.config.simulation import SimulationConfig
from qocjax.config.study import StudyConfig, build_problem

__all__ = ["Part", "SimulationConfig", "StudyConfig", "build_problem", "conf_dir", "load"]
