"""Many designs x seeds at the speed of the hardware."""

from qocjax.batch.evaluate import evaluate

__all__ = ["evaluate"]
