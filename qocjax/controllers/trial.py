"""One cycle of a law traced before anything runs, so that what is wrong with it is told at once and by its name."""

from __future__ import annotations

import sysconfig
import traceback
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, ShapeDtypeStruct

from qocjax._math import EXACT
from qocjax.controllers.interface import Controller, Sight, Task
from qocjax.controllers.rolled import PlanMaker
from qocjax.robots import Command, Pose, Robot, Unicycle
from qocjax.scenario import Design
from qocjax.tunables import CONTINUOUS, DESIGN

__all__ = ["failure_text", "try_out"]

_BATCH = (2, 3)  # designs and seeds, as a batch lays them out
_DTYPE = jnp.float32
_SLOTS = 4
_PLAN = 3  # commands of a packet, of a law that makes plans itself
_LONGEST = 300  # letters of somebody else's message
_LIBRARIES = (
    "<",
    str(Path(__file__).parents[1]),
    *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")),
)


def try_out(law: Controller, robots: int, robot: Robot | None = None) -> None:
    """Traces what a law does in a batch of runs, in float32 as studies have it; nothing is simulated or compiled.

    Args:
        law: A controller.
        robots: N.
        robot: What they are, whose commands the law has to give; by default unicycles.

    Raises:
        ValueError: A method fails, or gives back something else than `Controller` asks for.
    """
    name, robot = type(law).__name__, robot or Unicycle()
    try:
        with jax.enable_x64(False):
            begun, answers, report = jax.eval_shape(lambda given: _cycle(law, robot, given), _given(robots))
    except _WrongError as error:
        raise ValueError(f"{name}.{error}") from None
    except Exception as error:
        raise ValueError(f"{name}: {failure_text(error)}; QOCJAX_TRACEBACK=1 shows where") from error
    whole = (robots, *_BATCH)
    for method, (memory, command, _) in answers.items():
        if _shapes(memory) != _shapes(begun):
            raise ValueError(f"{name}.{method}: got memory of {_text(memory)} after {_text(begun)}, expected it to "
                             "stay of one shape and type")  # fmt: skip
        _check_command(f"{name}.{method}", command, robot, whole if method == "command" else (_PLAN, *whole))
    for key, value in report.items():
        if value.shape != whole:
            raise ValueError(f"{name}.report: got {key} of shape {value.shape}, expected one number for each robot "
                             f"and run, {whole}")  # fmt: skip


def _check_command(name: str, command: Command, robot: Robot, whole: tuple[int, ...]) -> None:
    """Checks that a command is one of the robot, or a plan one of M of them."""
    still = jax.eval_shape(robot.still, _given(whole[-3])["pose"])
    for each in fields(Command):
        value, wanted = getattr(command, each.name), getattr(still, each.name)
        if (value is None) != (wanted is None):
            raise ValueError(f"{name}: got {'no' if value is None else 'a'} {each.name}, expected what a "
                             f"{type(robot).__name__} takes (task.robot.steer gives it)")  # fmt: skip
        if value is not None and (value.shape, value.dtype) != (whole, _DTYPE):
            which = "as the poses are" if len(whole) == 3 else f"for each of the {whole[0]} commands as the poses are"
            raise ValueError(f"{name}: got {each.name} of {value.dtype}{list(value.shape)}, expected "
                             f"float32{list(whole)}, {which}")  # fmt: skip


class _WrongError(Exception):
    """What a method gave back is not what was asked for."""


def _given(robots: int) -> dict[str, Any]:
    """What a tick takes from outside, as shapes."""
    number = lambda *shape: ShapeDtypeStruct(shape, _DTYPE)  # noqa: E731
    words = jax.eval_shape(lambda: jax.random.key_data(jax.random.key(0)))
    return {
        "pose": Pose(*[number(robots, *_BATCH)] * 5),  # type: ignore[arg-type]
        "speed": Command(*[number(robots, *_BATCH)] * 2),  # type: ignore[arg-type]
        "age": number(robots, 1, _BATCH[1]),
        "goal": (number(robots, 1, 1),) * 2,
        "design": {name: number(1, _BATCH[0], 1) if name in CONTINUOUS else number() for name in DESIGN},
        "lag": ShapeDtypeStruct((), jnp.int32),
        "rest": number(),
        "tick": ShapeDtypeStruct((), jnp.int32),
        "keys": ShapeDtypeStruct((1, _BATCH[1], *words.shape), words.dtype),
    }


def _cycle(law: Controller, robot: Robot, given: dict[str, Any]) -> tuple[Any, Any, dict[str, Array]]:
    """What is remembered at first, what command and plan give back, and the report."""
    task = Task(given["goal"], Design(**given["design"]), EXACT, 100, given["lag"], given["rest"], _SLOTS, robot)
    memory = law.begin(task, given["pose"], given["keys"])
    speed = given["speed"] if law.sees_speed else None
    sight = Sight(given["tick"], given["pose"], given["age"], speed)
    answers = {"command": law.command(task, memory, sight)}
    if isinstance(law, PlanMaker):
        answers["plan"] = law.plan(task, memory, sight, _PLAN)
    for method, answer in answers.items():
        if not (isinstance(answer, tuple) and len(answer) == 3 and isinstance(answer[1], Command)):
            raise _WrongError(f"{method}: got {_kind(answer)}, expected (memory, Command, what is recorded)")
    report = law.report(answers["command"][0])
    if not isinstance(report, dict):
        raise _WrongError(f"report: got {_kind(report)}, expected a dict of arrays")
    # Constants count as arrays from here on.
    return jax.tree.map(jnp.asarray, (memory, answers, report))


def _shapes(memory: Any) -> tuple[Any, list[str]]:
    leaves, structure = jax.tree.flatten(memory)
    return structure, [f"{leaf.dtype}{list(leaf.shape)}" for leaf in leaves]


def _text(memory: Any) -> str:
    return ", ".join(_shapes(memory)[1]) or "nothing"


def _kind(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(type(each).__name__ for each in value)})"
    return type(value).__name__


def failure_text(error: BaseException) -> str:
    """An error of code that is not ours in one line, with the last line of that code that was reached."""
    text, places = str(error), [(each.filename, each.lineno) for each in traceback.extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError):
        text, places = error.msg, [(error.filename or "", error.lineno)]
    own = [f" ({file}, line {line})" for file, line in places if not file.startswith(_LIBRARIES)]
    text = " ".join(text.split())
    text = text if len(text) <= _LONGEST else text[:_LONGEST] + " ..."
    return f"{type(error).__name__}{': ' if text else ''}{text}{own[-1] if own else ''}"
