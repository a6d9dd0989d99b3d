"""Many designs x seeds at the speed of the hardware."""

from qocjax.batch.evaluate import evaluate
from qocjax.batch.gradient import gradient

__all__ = ["evaluate", "gradient"]
