"""What the command lines share: set-up of JAX for a program, and errors as one line without a traceback."""

from __future__ import annotations

import functools
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import hydra
import jax
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from qocjax._xla import request_whole_loop
from qocjax.batch.evaluate import unit_of
from qocjax.commands.help import register_help
from qocjax.commands.quoting import quoted_options
from qocjax.config import add_resolver, conf_dir, hydra_base
from qocjax.config.part import Part
from qocjax.store.study_folder import read_identity

__all__ = ["command", "given_options", "output_dir", "printed_unit", "resumed"]

C = TypeVar("C", bound=Part)


_LONGEST = 2000  # letters of an error


def command(
    name: str, short: dict[str, tuple[str, str]] | None = None, nav2: bool = False
) -> Callable[[Callable[[DictConfig], None]], Callable[[], None]]:
    """Makes a function of a configuration a Hydra command line with the primary configuration `conf/<name>.yaml`.

    Args:
        name: Of the configuration.
        short: Options that stand for two others: `path=FILE` for one that is given as it is, and one that takes the
            value, such as `{"path": ("network=trace", "network.path")}`.
        nav2: Whether it takes `nav2=FILE`, a file of Nav2's parameters that stands for options.
    """

    def wrap(main: Callable[[DictConfig], None]) -> Callable[[], None]:
        @functools.wraps(main)
        def guarded(cfg: DictConfig) -> None:
            try:
                if cfg.get("nav2") is not None and "nav2" not in given_options():
                    raise ValueError(f"nav2: got {cfg.nav2} from a configuration file, expected it on the command line")
                main(cfg)
            except (ValueError, TypeError, OSError) as error:
                if os.environ.get("QOCJAX_TRACEBACK"):
                    raise
                _fail(error)
            except Exception as error:
                if os.environ.get("QOCJAX_TRACEBACK"):
                    raise
                _fail(_unforeseen(error))
            except KeyboardInterrupt as stop:
                print(": ".join(["stopped", *map(str, stop.args)]), file=sys.stderr)
                sys.exit(130)

        run = hydra.main(config_path=str(conf_dir()), config_name=name, **hydra_base())(guarded)

        @functools.wraps(main)
        def entry() -> None:
            _set_up_jax()
            add_resolver("first_given", _first_given)
            register_help()
            warnings.formatwarning = lambda text, *rest, **more: f"note: {text}\n"  # what is told is for users
            arguments = _of_target(_expanded(sys.argv[1:], short or {}))
            os.environ["HYDRA_FULL_ERROR"] = "1"  # what Hydra finds comes out as an error, not as its many lines
            try:
                sys.argv[1:] = quoted_options(_of_nav2(arguments) if nav2 else arguments)
                _check_help(sys.argv[1:])
                run()
            except (HydraException, OmegaConfBaseException, OSError, ValueError) as error:
                if os.environ.get("QOCJAX_TRACEBACK"):
                    raise
                cause = error.__cause__  # the log that cannot be written comes out as a ValueError of `logging`
                _fail(cause if isinstance(cause, OSError) else error)

        return entry

    return wrap


def _check_help(arguments: Collection[str]) -> None:
    """The text of `--help` is a part of the configuration, and no choice."""
    for argument in arguments:
        if re.match(r"[+~]*help(@[^=]*)?(=|$)", argument):
            raise ValueError(f"help: got {argument}, expected --help")


def _expanded(arguments: list[str], short: dict[str, tuple[str, str]]) -> list[str]:
    found = []
    for argument in arguments:
        name, mark, value = argument.partition("=")
        found += [short[name][0], f"{short[name][1]}={value}"] if mark and name in short else [argument]
    return found


def _of_target(arguments: list[str]) -> list[str]:
    """With `controller._target_=my.module.Law` in them: a choice of its own, which may be given any argument."""
    if not any(re.match(r"[+]*controller\._target_=", each) for each in arguments):
        return arguments
    given = [re.sub(r"^[+]*(?=controller\.\w)", "++", each) for each in arguments]
    return given if any(each.startswith("controller=") for each in given) else ["controller=custom", *given]


def _of_nav2(arguments: list[str]) -> list[str]:
    """The arguments with what `nav2=FILE` stands for in front; what there is to tell goes to standard error."""
    if not any(each.startswith("nav2=") for each in arguments):
        return arguments
    from qocjax.nav2.command_line import with_nav2  # takes a while to import, and few commands need it

    found, notes = with_nav2(arguments)
    print("".join(f"note: {text}\n" for text in notes), end="", file=sys.stderr)
    return found


def _fail(error: Exception) -> NoReturn:
    """Ends the program with an error in one line."""
    text = str(error).partition("Config search path")[0].strip()  # Hydra lists folders there
    if isinstance(error, OSError) and error.filename and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    for lines, line in ((r":\s*\n\s*", ": "), (r"\.\s*\n\s*", ". "), (r"\s*\n\s*", ", ")):
        text = re.sub(lines, line, text)
    print(f"error: {text if len(text) <= _LONGEST else text[:_LONGEST] + ' ...'}", file=sys.stderr)
    sys.exit(2)


def _unforeseen(error: Exception) -> ValueError:
    """What no check foresaw, in a line: its kind, what it says, where it was raised, and how to see the rest."""
    at = traceback.extract_tb(error.__traceback__)[-1]
    said = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return ValueError(f"{said} ({at.filename}, line {at.lineno}); QOCJAX_TRACEBACK=1 shows the traceback, to report it")


def _first_given(*values: Any) -> Any:
    """The first value that is not null, for interpolations."""
    return next((value for value in values if value is not None), None)


def _set_up_jax() -> None:
    """Fast loops on CPUs, and compiled programs kept between runs in the user's cache folder."""
    request_whole_loop()
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        try:
            cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "qocjax" / "xla"
            jax.config.update("jax_compilation_cache_dir", str(cache))
        except RuntimeError:  # a user without a home has no cache
            pass
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def output_dir() -> Path:
    """Folder of this run's results."""
    return Path(HydraConfig.get().runtime.output_dir)


def given_options() -> list[str]:
    """Names of the options that the command line gives, without those of Hydra itself."""
    return [re.split(r"[=@]", option.lstrip("+~"))[0] for option in HydraConfig.get().overrides.task]


def resumed(config: C, resume: str | None, folder: Path, free: Collection[str]) -> C:
    """The configuration that a folder holds, with the options that may change; the given one where it was given.

    Args:
        config: What the command line asks.
        resume: The folder to go on with, if any.
        folder: Where results go.
        free: Options that results do not depend on.

    Raises:
        ValueError: The folder to go on with is not the one that the results go to, or holds no study of this command.
    """
    if resume is None:
        return config
    if Path(resume).resolve() != folder.resolve():
        raise ValueError(f"resume: got {resume} with results in {folder}, expected one folder")
    there = read_identity(folder)["configuration"]
    if others := sorted(set(there) - set(type(config).model_fields)):
        raise ValueError(f"resume: got {resume}, a study with {', '.join(others)}, expected one of this command")
    if any(name.split(".")[0] not in free for name in given_options()):
        return config  # what was asked for, to be compared with what is there
    return type(config).model_validate({**config.model_dump(include=set(free)), **there})


def printed_unit(name: str) -> str:
    """Unit of a value of a design, as it follows the number; nothing where it is a plain number."""
    unit = unit_of(name)
    return "" if unit == "1" else unit
